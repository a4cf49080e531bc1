//! A function as a file describes it, before it becomes control points.

use super::curve::Curve;
use super::error::TransferImportError;
use super::space::ColorSpace;

/// Light as a volume property has it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImportedLight {
    /// Ambient, diffuse and specular share, 0..1.
    pub shares: [f64; 3],
    /// Exponent of the highlight, 1..1000.
    pub shininess: f64,
}

/// The content of a file, in the file's own terms.
#[derive(Clone, Debug)]
pub(super) struct Draft {
    pub(super) name: Option<String>,
    pub(super) color: Curve<3>,
    pub(super) space: ColorSpace,
    pub(super) opacity: Curve<1>,
    /// Over the gradient's magnitude; HU per mm, as VTK's GPU mapper has it.
    pub(super) gradient: Option<Curve<1>>,
    pub(super) opacity_unit_mm: f64,
    pub(super) light: Option<ImportedLight>,
    pub(super) left_out: Vec<String>,
}

/// A function that has been found and not yet been read: of a file of many, only one is.
pub(super) type FoundFunction<'a> =
    (Option<String>, Box<dyn Fn() -> Result<Draft, TransferImportError> + 'a>);

/// Light of a volume property, checked; unlit ones show their colours as they are.
pub(super) fn light(
    place: &str,
    is_lit: bool,
    shares: [f64; 3],
    power: f64,
) -> Result<ImportedLight, TransferImportError> {
    for (what, share) in ["ambient", "diffuse", "specular"].into_iter().zip(shares) {
        if !(0.0..=1.0).contains(&share) {
            return Err(TransferImportError::range(&format!("{place}: {what}"), &share, "0 to 1"));
        }
    }
    if !(0.0..=1e6).contains(&power) {
        return Err(TransferImportError::range(&format!("{place}: specularPower"), &power, "0 to 1000000"));
    }
    let shares = if is_lit { shares } else { [1.0, 0.0, 0.0] };
    Ok(ImportedLight { shares, shininess: power.clamp(1.0, 1000.0) })
}
