//! Rule `views`: depth for displays, from a picture and two views cast beside it.
//!
//! The views beside have a quarter of the picture's pixels and the samples of moving pictures, so both
//! cost about a third of a picture. `relief_display::disparity_for_views` compares them with it. The
//! disparity is chosen for the display's parallax and becomes the view depth that has it, so that
//! every layout and the live protocol get the same depth. Picks and measurements use the depth of the
//! rays.
//!
//! Spaces: view depth in mm; eyes are in eye separations to the right of the picture's.

use std::sync::Arc;

use rayon::prelude::*;

use super::display_depth::ForViews;
use super::error::RenderError;
use super::frame::{BackLayer, RenderedFrame};
use super::overlay::Overlays;
use super::quality::Quality;
use super::request::RenderRequest;
use super::true_views::true_views;
use relief_base::{DepthLimits, Disparity};
use relief_display::{
    DisplayProfile, FrameEncoder, SideView, disparity_for_views, grounded_depth, hidden_layer,
};
use relief_volume::{ContentHash, Grid};

/// The places of the eyes beside a picture: half way to the outermost of nine views over four
/// separations. They do not depend on the layout, so that all layouts have the same depth.
const EYES: [f64; 2] = [-1.0, 1.0];

/// A picture whose views beside it were cancelled.
pub(super) struct Unfinished {
    pub(super) volume: ContentHash,
    /// That of the picture.
    pub(super) request: RenderRequest,
    pub(super) for_views: ForViews,
    pub(super) frame: RenderedFrame,
    /// Those that are cast.
    pub(super) views: Vec<RenderedFrame>,
}

/// The views beside a picture, and how their disparity becomes depth.
pub(super) struct ViewsBeside {
    encoder: FrameEncoder,
    limits: DepthLimits,
    requests: [RenderRequest; 2],
}

impl ViewsBeside {
    /// The views to cast beside a finished picture; `None` where there are none: for a parallel
    /// projection, a display without parallax, and where the depth limits put the screen behind the
    /// camera.
    pub(super) fn of(
        for_views: &ForViews,
        request: &RenderRequest,
        frame: &RenderedFrame,
        grid: &Grid,
    ) -> Result<Option<Self>, RenderError> {
        let display = &for_views.display;
        let encoder = display.encoder()?;
        let limits = frame.limits_for(display)?;
        let Ok(setup) = true_views(display, &frame.camera, frame.size_px, limits) else { return Ok(None) };
        if setup.baseline_mm == 0.0 {
            return Ok(None); // factor 0: every eye sees the same
        }
        let moving_mm = Quality::Moving.sample_distance_mm(request, grid);
        let view = |eye: f64| {
            let camera = frame.camera.seen_from_beside(eye * setup.baseline_mm, setup.converging_mm).ok()?;
            let (camera, size_px) = camera.every_second_pixel(frame.size_px).ok()?;
            Some(RenderRequest {
                camera,
                size_px,
                sample_distance_mm: request.sample_distance_mm.max(moving_mm),
                needs_depth: false,
                letters: false,
                overlays: Arc::new(Overlays::default()),
                ..request.of_rays()
            })
        };
        let views = view(EYES[0]).zip(view(EYES[1]));
        Ok(views.map(|(left, right)| Self { encoder, limits, requests: [left, right] }))
    }

    /// The views to cast, from left to right.
    pub(super) fn requests(&self) -> &[RenderRequest; 2] {
        &self.requests
    }

    /// Adds to a picture the depth for displays that fits the cast views best, and the background layer
    /// that only they show.
    pub(super) fn complete(&self, frame: &mut RenderedFrame, cast: &[RenderedFrame]) {
        let side = |at: usize| SideView { eye: EYES[at], color: &cast[at].color_rgba };
        let (encoder, limits, size_px, sides) =
            (&self.encoder, self.limits, frame.size_px, [side(0), side(1)]);
        let parallax = encoder.parallax(size_px[0]);
        let depth = |disparity: f32| depth_of(encoder.profile(), limits, disparity);

        let rays = encoder.disparity_of(&frame.depth_mm, limits);
        let disparity = disparity_for_views(size_px, &frame.color_rgba, &rays, &sides, &parallax);
        let display_mm = displayed(frame, &disparity.into_par_iter().map(depth).collect::<Vec<_>>());

        let front = encoder.disparity_of(&display_mm, limits);
        let hidden = hidden_layer(size_px, &frame.color_rgba, &front, &sides, &parallax);
        let behind = (hidden.disparity.par_iter(), front.par_iter(), display_mm.par_iter()).into_par_iter();
        let behind = behind.map(|(d, front, &mm)| if d == front { mm } else { depth(f32::from(*d)) });
        frame.back = Some(BackLayer { depth_mm: behind.collect(), color_rgba: hidden.color });
        frame.display_mm = Some(display_mm);
    }
}

/// The view depth that has a disparity, mm.
fn depth_of(profile: &DisplayProfile, limits: DepthLimits, disparity: f32) -> f32 {
    let z = profile.scaled_depth(Disparity(f64::from(disparity)));
    (limits.near_mm + z.0 * (limits.far_mm - limits.near_mm)) as f32
}

/// The depth of a picture for displays, from that of its rays or of views cast beside it.
pub(super) fn displayed(frame: &RenderedFrame, depth_mm: &[f32]) -> Vec<f32> {
    grounded_depth(frame.size_px[0] as usize, &frame.color_rgba, depth_mm)
}
