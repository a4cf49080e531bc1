//! A slice in place of a view from outside, from options: shared by render and bench.

use anyhow::bail;

use relief_render::{SceneFile, SlabBlend, SlicePlane};
use relief_volume::NamedPlane;

/// Options of a slice; they override the scene file.
#[derive(Debug, clap::Args)]
#[command(next_help_heading = "Slices")]
pub(super) struct SliceArguments {
    /// Show a slice: axial (seen from the feet), coronal (from the front) or sagittal (from the
    /// left)
    #[arg(long, value_name = "PLANE", value_parser = parse_plane, conflicts_with = "normal")]
    plane: Option<NamedPlane>,
    /// Show an oblique slice, whose normal points to the eye
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_triple, allow_hyphen_values = true)]
    normal: Option<[f64; 3]>,
    /// Up direction of an oblique slice [default: towards the head]
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_triple, allow_hyphen_values = true, requires = "normal")]
    up: Option<[f64; 3]>,
    /// Middle of the slice, patient LPS in mm; the volume's centre where left out
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_triple, allow_hyphen_values = true)]
    center_mm: Option<[f64; 3]>,
    /// Moves the slice towards the head (axial), the back (coronal), the left (sagittal) or along
    /// its normal
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    offset_mm: Option<f64>,
    /// Thickness of a slab around the plane; 0 is the plane only
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    slab_mm: Option<f64>,
    /// The value of the slab that is shown: mean, mip or minip
    #[arg(long, value_name = "BLEND", value_parser = parse_blend)]
    slab_blend: Option<SlabBlend>,
    /// Height of the slice's picture; the whole volume where left out
    #[arg(long, value_name = "MM", allow_negative_numbers = true)]
    height_mm: Option<f64>,
    /// Burn the patient directions into the edges of the slice
    #[arg(long)]
    letters: bool,
}

fn parse_plane(name: &str) -> Result<NamedPlane, String> {
    NamedPlane::from_name(name).ok_or_else(|| "planes are axial, coronal and sagittal".to_owned())
}

fn parse_blend(name: &str) -> Result<SlabBlend, String> {
    SlabBlend::from_name(name).ok_or_else(|| "blends are mean, mip and minip".to_owned())
}

pub(super) fn parse_triple(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|part| part.trim().parse().ok()).collect();
    let triple = numbers.and_then(|numbers| numbers.try_into().ok());
    triple.ok_or_else(|| "three numbers with commas between them, such as 0,-1,0.5".to_owned())
}

impl SliceArguments {
    /// Applies the options to a scene.
    pub(super) fn apply(&self, mut scene: SceneFile) -> anyhow::Result<SceneFile> {
        let plane = match (self.plane, self.normal) {
            (Some(plane), _) => Some(SlicePlane::Named(plane)),
            (None, Some(normal)) => {
                Some(SlicePlane::Oblique { normal, up: self.up.unwrap_or([0.0, 0.0, 1.0]) })
            }
            (None, None) => None,
        };
        let lengths = [self.offset_mm, self.slab_mm, self.height_mm];
        let others = lengths.iter().any(Option::is_some)
            || self.center_mm.is_some()
            || self.slab_blend.is_some()
            || self.letters;
        if plane.is_none() && !others {
            return Ok(scene);
        }
        if plane.is_none() && !scene.is_slice() {
            bail!(
                "--center-mm, --offset-mm, --slab-mm, --slab-blend, --height-mm and --letters belong to a slice; \
                 say which with --plane or --normal"
            );
        }
        if scene.has_camera() {
            bail!("the scene file has a camera; a slice has its own: leave --plane and --normal out");
        }
        let slice = scene.slice_mut();
        slice.plane = plane.unwrap_or(slice.plane);
        slice.center_mm = self.center_mm.or(slice.center_mm);
        slice.offset_mm = self.offset_mm.unwrap_or(slice.offset_mm);
        slice.slab_mm = self.slab_mm.unwrap_or(slice.slab_mm);
        slice.blend = self.slab_blend.unwrap_or(slice.blend);
        slice.height_mm = self.height_mm.or(slice.height_mm);
        slice.letters |= self.letters;
        Ok(scene)
    }
}
