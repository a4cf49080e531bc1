//! The result of a render: a picture with the view depth of every pixel, and its camera.

use relief_base::{DepthLimits, OutOfRange, Patient, Point, View, ViewDepth};
use relief_display::{DisplaySettings, LayoutError, Picture, visible_limits};
use relief_volume::Camera;

/// The times of the parts of a frame, ms.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Timings {
    /// Uploading what had changed; 0 when nothing had.
    pub upload_ms: f64,
    /// Ray casting and read-back, the views of rule `views` included.
    pub render_ms: f64,
    /// The part of it that rule `views` took: casting two views, and comparing them with the picture.
    pub views_ms: f64,
    /// Drawing overlays, and enlarging a reduced picture before; 0 where there is neither.
    pub overlay_ms: f64,
}

/// The background layer of a picture. Rule `two-layer`: what the rays meet behind the first layer. Rule
/// `views`: what only the views beside the picture show.
#[derive(Clone, Debug)]
pub struct BackLayer {
    /// Rows from the top. Display-referred sRGB over the request's background; the fourth byte is
    /// the coverage.
    pub color_rgba: Vec<[u8; 4]>,
    /// Rows from the top. View depth in mm, `+inf` where nothing lies behind.
    pub depth_mm: Vec<f32>,
}

/// Coverage from which a pixel counts as a surface: noise in air is fainter.
const LEAST_COVERAGE: u8 = 26;

/// A rendered picture.
#[derive(Clone, Debug)]
pub struct RenderedFrame {
    /// Width and height in pixels.
    pub size_px: [u32; 2],
    /// Rows from the top. Display-referred sRGB over the request's background; the fourth byte is
    /// the coverage.
    pub color_rgba: Vec<[u8; 4]>,
    /// Rows from the top. View depth in mm, `+inf` where the ray hit nothing.
    pub depth_mm: Vec<f32>,
    /// Rows from the top. View depth for displays in mm, `+inf` where nothing is shown: chosen by rule
    /// `views`; `None` under other rules, which have one depth for displays and picks.
    pub display_mm: Option<Vec<f32>>,
    /// The background layer of rule `two-layer`, and of rule `views` if it cast views beside the picture.
    pub back: Option<BackLayer>,
    /// The camera of the request.
    pub camera: Camera,
    /// Limits that keep depth steady while this volume turns: its bounding sphere around the focal
    /// point.
    pub limits: DepthLimits,
    /// View depth of the front of the nearest ball that was drawn over it, such as a cursor; `None`
    /// without one.
    pub nearest_ball_mm: Option<f64>,
    /// Whether only the chosen blocks of the request were cast; the others show the background.
    pub is_partial: bool,
    /// The times of its parts.
    pub timings: Timings,
}

impl RenderedFrame {
    /// The limits between which the depth of this frame is scaled. Those that follow its visible
    /// surfaces hold its nearest ball, which outweighs no percentile.
    ///
    /// # Errors
    /// When the limits of the settings contradict each other or the volume's.
    pub fn limits_for(&self, display: &DisplaySettings) -> Result<DepthLimits, OutOfRange> {
        let own = || {
            let pixels = self.depth_mm.iter().zip(&self.color_rgba);
            let seen = pixels.map(
                |(&depth, &[.., coverage])| {
                    if coverage >= LEAST_COVERAGE { depth } else { f32::INFINITY }
                },
            );
            let visible = visible_limits(&seen, self.limits.far_mm - self.limits.near_mm)?;
            let ball_mm = self.nearest_ball_mm.unwrap_or(f64::INFINITY);
            DepthLimits::new(visible.near_mm.min(ball_mm.max(0.0)), visible.far_mm)
        };
        let view_from_patient = self.camera.view_from_patient();
        let depth_of = |[x, y, z]: [f64; 3]| -(view_from_patient * Point::<Patient>::new(x, y, z)).xyz.z;
        display.limits_between(self.limits, own, depth_of)
    }

    /// The picture as displays get it: with the depth that is made for them, and the background
    /// layer. If rule `views` cast no views, the background layer is a copy of the picture.
    ///
    /// # Errors
    /// When the picture is too large for a frame.
    pub fn picture(&self) -> Result<Picture<'_>, LayoutError> {
        let depth_mm = self.display_mm.as_ref().unwrap_or(&self.depth_mm);
        let picture = Picture::new(self.size_px, &self.color_rgba, depth_mm)?;
        match &self.back {
            Some(back) => picture.with_back(&back.color_rgba, &back.depth_mm),
            None if self.has_back_layer() => picture.with_back(&self.color_rgba, depth_mm),
            None => Ok(picture),
        }
    }

    /// Whether [`RenderedFrame::picture`] has a background layer: under rules `two-layer` and `views`.
    #[must_use]
    pub const fn has_back_layer(&self) -> bool {
        self.back.is_some() || self.display_mm.is_some()
    }

    /// Copies the depth of overlays into the depth for displays. `before` is the depth of the picture
    /// without overlays.
    pub(super) fn copy_overlay_depth(&mut self, before: &[f32]) {
        let Some(display_mm) = &mut self.display_mm else { return };
        let drawn = self.depth_mm.iter().zip(before);
        for (shown, (drawn, _)) in display_mm.iter_mut().zip(drawn).filter(|(_, (a, b))| a != b) {
            *shown = *drawn;
        }
    }

    /// View depth of a pixel (column, row).
    ///
    /// # Panics
    /// When the pixel is outside the picture.
    #[must_use]
    pub fn depth_at(&self, [column, row]: [u32; 2]) -> ViewDepth {
        ViewDepth(self.depth_mm[(row * self.size_px[0] + column) as usize])
    }

    /// The patient position that a pixel shows; `None` where its ray hit nothing.
    ///
    /// # Panics
    /// When the pixel is outside the picture.
    #[must_use]
    pub fn pick(&self, pixel: [u32; 2]) -> Option<Point<Patient>> {
        self.point_at(pixel, self.depth_at(pixel))
    }

    /// The patient position at this view depth behind a pixel (column, row); `None` without a depth.
    #[must_use]
    pub fn point_at(&self, pixel: [u32; 2], depth: ViewDepth) -> Option<Point<Patient>> {
        let [half_x, half_y] = self.camera.half_extent(self.size_px);
        let [shift_x, shift_y] = self.camera.lens_shift();
        let x = ((f64::from(pixel[0]) + 0.5) / f64::from(self.size_px[0]) * 2.0 - 1.0) * half_x + shift_x;
        let y = (1.0 - (f64::from(pixel[1]) + 0.5) / f64::from(self.size_px[1]) * 2.0) * half_y + shift_y;
        let depth_mm = f64::from(depth.0);
        let spread = match self.camera.projection() {
            relief_volume::Projection::Perspective { .. } => depth_mm,
            relief_volume::Projection::Orthographic { .. } => 1.0,
        };
        let in_view = Point::<View>::new(x * spread, y * spread, -depth_mm);
        depth.is_hit().then(|| self.camera.patient_from_view() * in_view)
    }
}
