//! From a value to a lit colour; twin of `shaders/lib/classify.wgsl`.

use glam::{DVec3, DVec4};

use crate::request::Shading;
use relief_volume::{GradientTable, TransferTable};

/// Colour and opacity of one sample.
pub(super) fn classify(table: &TransferTable, hu: f64) -> DVec4 {
    let last = (table.entries.len() - 1) as f64;
    let x = ((hu - f64::from(table.first_hu)) / f64::from(table.step_hu)).clamp(0.0, last);
    let i = (x as usize).min(table.entries.len() - 2);
    let entry = |i: usize| DVec4::from(table.entries[i].map(f64::from));
    entry(i).lerp(entry(i + 1), x - i as f64)
}

/// The factor of a value's opacity at this gradient magnitude, HU/mm; twin of
/// `shaders/lib/gradient.wgsl`.
pub(super) fn gradient_factor(table: &GradientTable, gradient: DVec3) -> f64 {
    let last = table.entries.len() - 1;
    let x = (gradient.length() * f64::from(table.entries_per_hu_mm)).min(last as f64);
    let i = (x as usize).min(last - 1);
    let [low, high] = [i, i + 1].map(|i| f64::from(table.entries[i]));
    low + (x - i as f64) * (high - low)
}

/// Opacity of one sample from that of its value, per opacity unit, and its factor.
pub(super) fn modulated(table: &GradientTable, opacity: f64, factor: f64) -> f64 {
    1.0 - (1.0 - opacity * factor).max(0.0).powf(f64::from(table.path_units))
}

/// Headlight at the eye, two-sided; only ambient light where the gradient has no length. Patient
/// axes.
pub(super) fn shade(light: &Shading, rgb: DVec3, gradient: DVec3, direction: DVec3) -> DVec3 {
    if gradient.length_squared() < 1e-12 {
        return rgb * light.ambient;
    }
    let facing = gradient.normalize().dot(direction).abs().min(1.0);
    rgb * (light.ambient + light.diffuse * facing) + light.specular * facing.powf(light.shininess)
}
