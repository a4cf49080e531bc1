//! The reference: the ray caster in one lane of 64 bits, which takes every sample.
//!
//! Tests compare the shaders and the lanes of 32 bits with it; closed forms hold it to the formulas.

use std::ops::ControlFlow;

use super::super::bands::Bands;
use super::super::error::RenderError;
use super::super::frame::RenderedFrame;
use super::super::letters;
use super::super::overlay::Drawing;
use super::super::request::RenderRequest;
use super::super::skipping::EmptySpaceSkipping;
use super::super::volume_plan::VolumeLimits;
use super::super::watch::Watch;
use super::cast::{Order, Width};
use super::prepared::Cache;
use relief_volume::Volume;

/// Renders one picture in 64 bits on the processor, without skipping. For mode path-traced this is the
/// picture of mode composite, whose depth it has.
///
/// # Errors
/// When the request is out of range, or the volume too large.
pub fn render_reference(volume: &Volume, request: &RenderRequest) -> Result<RenderedFrame, RenderError> {
    let volume = request.shown(volume);
    request.validate_on(volume.grid())?;
    let drawing = Drawing::new(request, volume.grid())?;
    let order = Order {
        volume,
        request,
        skipping: EmptySpaceSkipping::Off,
        plan: &VolumeLimits::of_processor().plan(volume.grid().dims())?,
        width: Width::Double,
        bands: Bands::of_processor(),
    };
    let mut goes_on = |_| ControlFlow::Continue(());
    let mut frame = order.cast(&mut Cache::default(), &mut None, &mut Watch::new(&mut goes_on))?;
    if request.letters {
        letters::burn(&mut frame);
    }
    if let Some(drawing) = drawing {
        drawing.draw(&mut frame);
    }
    Ok(frame)
}
