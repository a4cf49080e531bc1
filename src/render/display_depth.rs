//! What rule `views` makes depth for.

use std::sync::Arc;

use relief_display::DisplaySettings;

/// How rule `views` chooses depths.
#[derive(Clone, Debug, PartialEq)]
pub struct ForViews {
    /// The display that makes views of the picture: its parallax and its depth limits count.
    pub display: Arc<DisplaySettings>,
    /// Whether two views beside the picture are cast to compare it with. Otherwise depths are those
    /// of the rays without outliers, and almost transparent pixels are far: for moving pictures.
    pub casts_views: bool,
}
