//! The settings of depth rule `views`.

use std::sync::Arc;

use relief_display::DisplaySettings;

/// How rule `views` chooses depths.
#[derive(Clone, Debug, PartialEq)]
pub struct ForViews {
    /// The parallax and the depth limits of the display. Other settings are the default ones, so that
    /// layouts share a picture.
    pub display: Arc<DisplaySettings>,
    /// Whether two views beside the picture are cast to compare it with. Otherwise depths are those
    /// of the rays without outliers, and almost transparent pixels are far: for moving pictures.
    pub casts_views: bool,
}

impl ForViews {
    /// Depth for a display, with views cast beside the picture.
    #[must_use]
    pub fn new(display: &DisplaySettings) -> Self {
        Self { display: Arc::new(display.of_depth()), casts_views: true }
    }
}
