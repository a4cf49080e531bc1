//! The f64 twin of the ray-casting shaders: the same functions under the same names, on the CPU.
//!
//! It exists to be compared with, not to be fast: tests render a request here and on the GPU and
//! compare pixels. It takes the request itself and samples voxels by plain trilinear interpolation.
//! It shares with the GPU path the request, the transfer table, the camera, the depth limits and
//! the overlays' pass, which tests of their own hold against closed forms.
//!
//! For mode path-traced the twin computes only the depth, which is that of composite; its colours
//! are those of composite too.
//!
//! | here | shader |
//! |---|---|
//! | `ray` | `shaders/lib/frame.wgsl` |
//! | `field` | `shaders/lib/volume.wgsl` |
//! | - | `shaders/lib/walk.wgsl`: skipping changes nothing |
//! | `classify` | `shaders/lib/classify.wgsl` |
//! | `illumination` | `shaders/illuminate.wgsl` |
//! | `lights` | `shaders/lib/lights.wgsl` |
//! | `labels` | `shaders/lib/labels.wgsl` |
//! | `isosurface` | `shaders/raycast/isosurface.wgsl` |
//! | `project` | `shaders/raycast/project.wgsl` |
//! | `depth_rules` | `shaders/lib/depth_rules.wgsl` |
//! | `cast` | `shaders/raycast.wgsl` |
//! | `slice` | `shaders/slice.wgsl` |

mod cast;
mod classify;
mod depth_rules;
mod field;
mod illumination;
mod isosurface;
mod labels;
mod lights;
mod passage;
mod project;
mod ray;
mod slice;

use rayon::prelude::*;

use super::error::RenderError;
use super::frame::{BackLayer, RenderedFrame, Timings};
use super::letters;
use super::limits::depth_limits;
use super::overlay::Drawing;
use super::request::RenderRequest;
use relief_volume::Volume;

/// Renders one picture on the CPU in f64.
///
/// # Errors
/// When the request is out of range.
pub fn render_reference(volume: &Volume, request: &RenderRequest) -> Result<RenderedFrame, RenderError> {
    let volume = request.shown(volume);
    request.validate_on(volume.grid())?;
    let drawing = Drawing::new(request, volume.grid())?;
    let scene = cast::Caster::new(volume, request);
    let [width, height] = request.size_px;
    let pixels: Vec<[cast::ShownPixel; 2]> = (0..height)
        .into_par_iter()
        .flat_map_iter(|row| (0..width).map(move |column| [column, row]))
        .map(|pixel| scene.raycast(pixel))
        .collect();
    let (color_rgba, depth_mm) = pixels.iter().map(|[front, _]| *front).unzip();
    let back = request.has_back_layer().then(|| {
        let (color_rgba, depth_mm) = pixels.iter().map(|[_, back]| *back).unzip();
        BackLayer { color_rgba, depth_mm }
    });
    let mut frame = RenderedFrame {
        size_px: request.size_px,
        color_rgba,
        depth_mm,
        back,
        camera: request.camera,
        limits: depth_limits(&request.camera, volume.grid()),
        nearest_ball_mm: None,
        timings: Timings::default(),
    };
    if request.letters {
        letters::burn(&mut frame);
    }
    if let Some(drawing) = drawing {
        drawing.draw(&mut frame);
    }
    Ok(frame)
}
