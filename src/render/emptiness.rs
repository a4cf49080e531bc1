//! Warnings about pictures that show nothing, and about depth that is flat.
//!
//! Depths: view depth, mm.

use std::fmt;

use super::frame::RenderedFrame;
use super::framing::{is_visible, visible_points};
use super::mode::Mode;
use super::request::RenderRequest;
use super::scene::Subject;
use relief_base::{DepthLimits, Patient, Point};
use relief_display::DisplaySettings;
use relief_volume::Projection;

/// Warnings about a picture that was rendered as requested.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum PictureWarning {
    /// No ray hit anything.
    NothingVisible(EmptyCause),
    /// All that is visible is beyond the depth limits, on one side or both.
    FlatDepth {
        /// The limits of the picture.
        limits: DepthLimits,
        /// The nearest and the farthest visible depth, mm.
        visible_mm: [f32; 2],
    },
}

/// Why a picture shows nothing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EmptyCause {
    /// No value of the volume is visible; it has values between these, HU.
    Transfer([i16; 2]),
    /// Clips or hidden segments remove everything that is visible.
    Clip,
    /// The projection of what is in the picture is outside of the window.
    Window,
    /// The rays miss the rest.
    Camera,
}

impl PictureWarning {
    /// The warning about a picture of a volume, whose values are between `range_hu`; `None` where it
    /// shows something and has depth.
    #[must_use]
    pub fn of(
        frame: &RenderedFrame,
        display: &DisplaySettings,
        request: &RenderRequest,
        subject: &Subject<'_>,
        range_hu: (i16, i16),
    ) -> Option<Self> {
        let depths = || frame.depth_mm.iter().copied().filter(|depth| depth.is_finite());
        if depths().next().is_none() {
            return Some(Self::NothingVisible(EmptyCause::of(request, subject, range_hu)));
        }
        if display.near_mm.is_none() && display.far_mm.is_none() {
            return None; // limits that no request has set hold all that is visible
        }
        let limits = frame.limits_for(display).ok()?;
        if depths().map(f64::from).any(|depth| limits.near_mm < depth && depth < limits.far_mm) {
            return None;
        }
        let visible_mm = [depths().fold(f32::MAX, f32::min), depths().fold(f32::MIN, f32::max)];
        Some(Self::FlatDepth { limits, visible_mm })
    }

    /// The name in HTTP headers and JSON.
    #[must_use]
    pub const fn code(&self) -> &'static str {
        match self {
            Self::NothingVisible(_) => "nothing-visible",
            Self::FlatDepth { .. } => "flat-depth",
        }
    }
}

impl fmt::Display for PictureWarning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NothingVisible(cause) => write!(f, "nothing is visible: {cause}"),
            Self::FlatDepth { limits, visible_mm: [nearest, farthest] } => write!(
                f,
                "near_mm and far_mm, {:.1} to {:.1}, leave out all that is visible, at {nearest:.1} to {farthest:.1} mm: the picture has no depth",
                limits.near_mm, limits.far_mm
            ),
        }
    }
}

impl EmptyCause {
    /// Why a request's picture shows nothing, if it does so. Clips and segments are judged where the
    /// subject has an occupancy.
    fn of(request: &RenderRequest, subject: &Subject<'_>, (low, high): (i16, i16)) -> Self {
        let Some(occupancy) = subject.content.occupancy() else { return Self::Camera };
        let visible = occupancy.cells(|low, high| is_visible(request, subject.grid, low, high));
        if visible.points(subject.grid).is_empty() {
            return Self::Transfer([low, high]);
        }
        let points = visible_points(occupancy, subject.grid, request);
        if points.is_empty() {
            return Self::Clip;
        }
        let is_ray = matches!(request.mode, Mode::Composite | Mode::PathTraced | Mode::Isosurface);
        let is_projection = !is_ray && !matches!(request.mode, Mode::Slice(_));
        if is_projection && points.iter().any(|point| is_in_picture(request, *point)) {
            Self::Window
        } else {
            Self::Camera
        }
    }
}

/// Whether the camera of a request sees a point.
fn is_in_picture(request: &RenderRequest, point: Point<Patient>) -> bool {
    let camera = &request.camera;
    let view = (camera.view_from_patient() * point).xyz;
    let depth_mm = -view.z;
    let spread = match camera.projection() {
        Projection::Perspective { .. } => depth_mm,
        Projection::Orthographic { .. } => 1.0,
    };
    let ([half_x, half_y], [shift_x, shift_y]) = (camera.half_extent(request.size_px), camera.lens_shift());
    let is_within = |place: f64, shift: f64, half: f64| (place / spread - shift).abs() <= half;
    depth_mm > 0.0 && is_within(view.x, shift_x, half_x) && is_within(view.y, shift_y, half_y)
}

impl fmt::Display for EmptyCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Transfer([low, high]) => {
                write!(
                    f,
                    "the transfer function or isosurface shows no value of the volume, {low} to {high} HU"
                )
            }
            Self::Clip => {
                f.write_str("clip planes, box, sphere or hidden segments remove everything that is visible")
            }
            Self::Window => {
                f.write_str("the projection has no value that the transfer function or window shows")
            }
            Self::Camera => f.write_str("the camera, or the slice's plane, misses the volume"),
        }
    }
}
