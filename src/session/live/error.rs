//! Errors of live views.

use std::error::Error;
use std::sync::Arc;

use crate::volumes::ReadError;
use crate::{JobError, ServiceError};
use relief_annotation::SnapError;
use relief_base::OutOfRange;
use relief_live::IntentError;
use relief_render::SceneError;
use relief_render::TrueViewsError;
use relief_volume::CameraError;

/// A change of a view was refused, or its next frame could not be made.
#[derive(Debug, thiserror::Error)]
pub enum LiveError {
    /// The scene has a syntax error or a value out of range.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// A value of the request, a display setting, or the volume's box is out of range.
    #[error(transparent)]
    Range(#[from] OutOfRange),
    /// The view refuses an intent.
    #[error(transparent)]
    Intent(#[from] IntentError),
    /// The state of the view gives no valid camera.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// A setting for snapping is out of range.
    #[error(transparent)]
    Snap(#[from] SnapError),
    /// A key of a scene that is set elsewhere in a live session.
    #[error("scene.{key} has no place in a live scene; use {instead}")]
    SceneKey {
        /// The key.
        key: &'static str,
        /// The setting to use instead.
        instead: &'static str,
    },
    /// A picture has no views for other eyes.
    #[error(transparent)]
    TrueViews(#[from] TrueViewsError),
    /// The voxels of the volume could not be read again.
    #[error(transparent)]
    Voxels(#[from] ReadError),
    /// The render queue refused or failed.
    #[error(transparent)]
    Service(#[from] ServiceError),
    /// A frame could not be encoded.
    #[error("{what} failed: {source}")]
    Encoding {
        /// The encoded object.
        what: &'static str,
        /// Why it failed.
        source: Box<dyn Error + Send + Sync>,
    },
    /// A blocking job did not finish.
    #[error(transparent)]
    Job(#[from] JobError),
    /// The annotations could not be read.
    #[error("the annotations could not be read: {0}")]
    Annotations(#[source] Arc<dyn Error + Send + Sync>),
}

impl LiveError {
    pub(super) fn encoding(what: &'static str, source: impl Error + Send + Sync + 'static) -> Self {
        Self::Encoding { what, source: Box::new(source) }
    }

    /// The JSON path of the setting that is wrong, where the error is about one.
    #[must_use]
    pub fn path(&self) -> Option<String> {
        match self {
            Self::Range(error) => Some(error.path.clone()),
            Self::SceneKey { key, .. } => Some(format!("scene.{key}")),
            Self::Intent(_) | Self::Camera(_) => Some("intent".to_owned()),
            _ => None,
        }
    }

    /// Whether the same change may succeed later: the request is valid, and the failure was the
    /// server's.
    #[must_use]
    pub fn is_temporary(&self) -> bool {
        match self {
            Self::Voxels(error) => !matches!(error, ReadError::Changed),
            Self::Service(error) => !matches!(error, ServiceError::Backend(crate::BackendError::Refused(_))),
            Self::Encoding { .. } | Self::Job(_) | Self::Annotations(_) => true,
            _ => false,
        }
    }
}
