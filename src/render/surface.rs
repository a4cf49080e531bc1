//! Isosurfaces of a request: at which values, in which colours, how opaque.
//!
//! The intersection of rays with surfaces is in `shaders/raycast/isosurface.wgsl` and its twin.
//! Values in HU.

use super::mode::Mode;
use relief_base::OutOfRange;
use relief_volume::TransferFunction;

/// A surface at a value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// The value in HU, within ±[`Surface::MOST_HU`].
    pub hu: f64,
    /// Colour before light, display-referred sRGB, 0..1.
    pub rgb: [f64; 3],
    /// Opacity of one crossing, above 0 and up to 1.
    pub opacity: f64,
}

impl Surface {
    /// Most surfaces of a request.
    pub const MOST: usize = 8;

    /// Values lie within this, on both sides of 0, HU.
    pub const MOST_HU: f64 = 32767.0;

    /// Least distance of two surfaces, HU.
    pub const LEAST_APART_HU: f64 = 0.1;

    /// The value at which crossings are looked for: 1/64 HU above the surface's own.
    ///
    /// Voxels are whole HU, and so are most surfaces: in a body of that very value, rounding would
    /// put samples now on one side and now on the other.
    #[must_use]
    pub fn level_hu(&self) -> f64 {
        self.hu + 1.0 / 64.0
    }

    /// Whether values of this range may lie on both sides of the surface; a little more, since
    /// sampling rounds.
    #[must_use]
    pub(super) fn may_lie_within(&self, low_hu: f32, high_hu: f32) -> bool {
        const ROUNDING_HU: f64 = 0.05;
        let level = self.level_hu();
        (f64::from(low_hu) - ROUNDING_HU..=f64::from(high_hu) + ROUNDING_HU).contains(&level)
    }

    /// The opaque surface at a value, in the transfer function's colour.
    #[must_use]
    pub fn opaque(hu: f64, transfer: &TransferFunction) -> Self {
        let [r, g, b, _] = transfer.at(hu);
        Self { hu, rgb: [r, g, b], opacity: 1.0 }
    }
}

/// The value at which opacity first reaches half of its maximum: the middle of a window, the
/// visible edge of a preset.
pub(super) fn usual_hu(transfer: &TransferFunction) -> f64 {
    let points = transfer.points();
    let half = 0.5 * points.iter().map(|point| point.rgba[3]).fold(0.0, f64::max);
    let reaches = |pair: &&[relief_volume::ControlPoint]| pair[0].rgba[3] < half && pair[1].rgba[3] >= half;
    points.windows(2).find(reaches).map_or(points[0].hu, |pair| {
        let [low, high] = [pair[0].rgba[3], pair[1].rgba[3]];
        pair[0].hu + (half - low) / (high - low) * (pair[1].hu - pair[0].hu)
    })
}

/// Checks the surfaces of a request: some for isosurfaces, rising, each in range; none for other
/// modes.
///
/// # Errors
/// The first that is wrong.
pub(super) fn validate(mode: Mode, surfaces: &[Surface]) -> Result<(), OutOfRange> {
    let count = surfaces.len();
    let allowed = if mode == Mode::Isosurface { 1..=Surface::MOST } else { 0..=0 };
    if !allowed.contains(&count) {
        let allowed = format!("1 to {} with mode isosurface, none with another", Surface::MOST);
        return Err(OutOfRange::new("surfaces", format!("{count} surfaces"), allowed));
    }
    for (i, surface) in surfaces.iter().enumerate() {
        let path = |key: &str| format!("surfaces[{i}].{key}");
        if surface.hu.is_nan() || surface.hu.abs() > Surface::MOST_HU {
            let allowed = format!("-{most} to {most}", most = Surface::MOST_HU);
            return Err(OutOfRange::new(path("hu"), surface.hu, allowed));
        }
        if let Some(channel) = surface.rgb.iter().find(|channel| !(0.0..=1.0).contains(*channel)) {
            return Err(OutOfRange::new(path("rgb"), channel, "0 to 1"));
        }
        if !(surface.opacity > 0.0 && surface.opacity <= 1.0) {
            return Err(OutOfRange::new(path("opacity"), surface.opacity, "above 0, up to 1"));
        }
        let previous = i.checked_sub(1).map(|i| surfaces[i].hu);
        if let Some(previous) = previous.filter(|previous| surface.hu < previous + Surface::LEAST_APART_HU) {
            let allowed = format!("at least {} HU above {previous}, the one before", Surface::LEAST_APART_HU);
            return Err(OutOfRange::new(path("hu"), surface.hu, allowed));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_volume::{PRESETS, Window};

    #[test]
    fn the_usual_value_is_a_windows_middle_and_within_a_presets_rise() {
        let window = Window::grey(40.0, 400.0).translucent().unwrap();
        assert!((usual_hu(&window) - 40.0).abs() < 1e-9);
        for preset in PRESETS {
            let transfer = preset.transfer();
            let largest = transfer.points().iter().map(|point| point.rgba[3]).fold(0.0, f64::max);
            let there = transfer.at(usual_hu(&transfer))[3];
            assert!((there - largest / 2.0).abs() < 1e-9, "{}: {there} of {largest}", preset.name);
        }
    }
}
