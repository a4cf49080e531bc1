//! Errors of simulations and measurements.

use relief_base::OutOfRange;
use relief_live::{CodecError, IntentError};
use relief_render::{RenderError, SceneError};
use relief_session::{EncodingError, ServiceError};
use relief_store::StoreError;
use relief_tracking::CalibrationError;
use relief_volume::CameraError;

/// A study could not be carried out.
#[derive(Debug, thiserror::Error)]
pub enum StudyError {
    /// The simulated survey did not calibrate the camera of the remote.
    #[error("the simulated survey did not calibrate the camera: {0}")]
    Calibration(#[from] CalibrationError),
    /// The simulated hand was lost by the tracker before it placed anything.
    #[error("the tracker lost a simulated hand before it placed anything")]
    HandLost,
    /// The options of the hand are invalid.
    #[error(transparent)]
    Hand(#[from] IntentError),
    /// A landmark could not be rendered.
    #[error("cannot show {landmark}: {source}")]
    Landmark {
        /// Name of the landmark.
        landmark: String,
        /// Why.
        source: Box<StudyError>,
    },
    /// A camera of a standard view is invalid.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The scene is invalid.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A frame could not be rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// The render queue failed.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// A frame could not be encoded.
    #[error(transparent)]
    Encoding(#[from] EncodingError),
    /// A live frame could not be encoded.
    #[error(transparent)]
    Codec(#[from] CodecError),
    /// A picture has the wrong number of pixels.
    #[error(transparent)]
    Picture(#[from] relief_display::LayoutError),
    /// The display settings are invalid.
    #[error(transparent)]
    Display(#[from] OutOfRange),
    /// The store of annotations failed.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The system gave no thread, no temporary folder or no random numbers.
    #[error(transparent)]
    System(#[from] std::io::Error),
}
