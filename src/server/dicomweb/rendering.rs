//! From the parameters of a rendered volume to a scene, and to the Rendered Volume Response Module,
//! which reports the parameters in use (PS3.18 2024d, Annex K).
//!
//! The projection is parallel (8.3.5.3.3). A viewpoint's position says the direction only: rays
//! start outside the volume, however near it is. The picture shows the whole volume around its
//! centre, whatever is looked at, so that moving the viewpoint moves the picture and does not scale
//! it. Patient LPS, mm; windows in HU.

use serde_json::{Map, Value, json};

use super::parameters::{Method, Parameters, Reformat, View, Window, WindowFunction};
use crate::problem::Problem;
use relief_base::{Patient, Point, Vector};
use relief_render::{Scene, SceneFile};
use relief_volume::{Anatomy, Grid, Orbit, PlaneView};

/// Side of a picture whose viewport is not said.
const USUAL_PX: u32 = 512;

/// A scene and its Rendered Volume Response Module.
pub(super) struct Rendering {
    pub(super) scene: Scene,
    /// The response module as DICOM JSON (PS3.18, Annex F).
    pub(super) module: Value,
}

/// The complete viewpoint.
#[derive(Clone, Copy, Debug)]
struct Viewpoint {
    position: Point<Patient>,
    look_at: Point<Patient>,
    up: Vector<Patient>,
}

/// The scene of a query for a volume on `grid` with this anatomy. Values that are not HU have a
/// window over all of them.
///
/// # Errors
/// When the viewpoint shows nothing, or the scene is out of range.
pub(super) fn rendering(
    parameters: &Parameters,
    reformat: Reformat,
    grid: &Grid,
    anatomy: Anatomy,
) -> Result<Rendering, Problem> {
    let method = parameters.method.unwrap_or(match reformat {
        Reformat::ThreeD => Method::VolumeRendered,
        Reformat::Mpr => Method::Average,
    });
    let is_hu = anatomy.quantity().is_hu();
    let usual = || if is_hu { usual_window(method, reformat) } else { whole_window(anatomy) };
    let window = (reformat == Reformat::Mpr || method != Method::VolumeRendered || !is_hu)
        .then(|| parameters.window.unwrap_or_else(usual));
    let viewpoint = viewpoint(parameters.view, reformat, grid)?;
    let size_px = parameters.viewport.unwrap_or([USUAL_PX; 2]);
    let mut scene = json!({ "size_px": size_px, "display": { "layout": "color" } });
    if let Some(window) = window {
        scene["transfer"] = transfer(window);
    }
    let height_mm = viewpoint.fitting_height_mm(grid, size_px)?;
    match reformat {
        Reformat::ThreeD => {
            scene["mode"] = json!(mode(method));
            scene["camera"] = viewpoint.camera(grid, height_mm);
        }
        Reformat::Mpr => {
            scene["mode"] = json!("slice");
            scene["slice"] = viewpoint.slice(parameters.slab_mm, method, height_mm);
        }
    }
    let scene = SceneFile::from_value(&scene)?.resolve(grid, &Orbit::default())?;
    Ok(Rendering { scene, module: module(reformat, method, viewpoint, parameters.slab_mm, window) })
}

/// The mode of a projection.
fn mode(method: Method) -> &'static str {
    match method {
        Method::VolumeRendered => "composite",
        Method::Maximum => "mip",
        Method::Minimum => "minip",
        // The mean of the values (8.3.5.3.3), not that of their opacities.
        Method::Average => "mean",
    }
}

/// The default window: bone and vessels, airways, or soft tissue.
fn usual_window(method: Method, reformat: Reformat) -> Window {
    let (center, width) = match (reformat, method) {
        (Reformat::ThreeD, Method::Maximum) => (400.0, 1600.0),
        (Reformat::ThreeD, Method::Minimum) => (-600.0, 1200.0),
        _ => (40.0, 400.0),
    };
    Window { center, width, shape: WindowFunction::Linear }
}

fn whole_window(anatomy: Anatomy) -> Window {
    let [center, width] = anatomy.window_hu();
    Window { center, width, shape: WindowFunction::LinearExact }
}

/// A window's ramp. `linear` is half a value lower and one value narrower than its numbers (PS3.3,
/// C.11.2.1.2.1).
fn transfer(Window { center, width, shape }: Window) -> Value {
    let (center, width) = match shape {
        WindowFunction::Linear => (center - 0.5, (width - 1.0).max(1.0)),
        WindowFunction::LinearExact => (center, width),
    };
    json!({ "window": { "center_hu": center, "width_hu": width } })
}

/// Direction to the eye and up of a side (8.3.5.3.4).
fn side(letter: char) -> (Vector<Patient>, Vector<Patient>) {
    let head = Vector::new(0.0, 0.0, 1.0);
    let front = Vector::new(0.0, -1.0, 0.0);
    match letter {
        'p' => (-front, head),
        'r' => (Vector::new(-1.0, 0.0, 0.0), head),
        'l' => (Vector::new(1.0, 0.0, 0.0), head),
        'h' => (head, front),
        'f' => (-head, front),
        _ => (front, head),
    }
}

fn viewpoint(view: View, reformat: Reformat, grid: &Grid) -> Result<Viewpoint, Problem> {
    let usual = if reformat == Reformat::Mpr { 'f' } else { 'a' };
    let (letter, given) = match view {
        View::Side(letter) => (letter.unwrap_or(usual), [None; 3]),
        View::Viewpoint { position, look_at, up } => (usual, [position, look_at, up]),
    };
    let [position, look_at, up] = given;
    let point = |xyz: [f64; 3]| Point::<Patient>::from_xyz(xyz.into());
    let look_at = look_at.map_or(grid.center(), point);
    let (towards_eye, side_up) = side(letter);
    let position = position.map_or(look_at + towards_eye * (2.0 * reach(grid, look_at)), point);
    let up = match (up, view) {
        (Some(up), _) => Vector::from_xyz(up.into()),
        (None, View::Side(_)) => side_up,
        // The head is up, but for views along the patient's axis.
        (None, View::Viewpoint { .. }) => {
            let head = side('a').1;
            let along =
                (position - look_at).normalized().is_some_and(|axis| axis.cross(head).length() < 1e-3);
            if along { side('h').1 } else { head }
        }
    };
    Ok(Viewpoint { position, look_at, up })
}

/// Distance from a point to the farthest corner of the volume, mm.
fn reach(grid: &Grid, from: Point<Patient>) -> f64 {
    grid.corners().into_iter().map(|corner| corner.distance(from)).fold(0.0, f64::max)
}

impl Viewpoint {
    fn towards_eye(&self) -> Vector<Patient> {
        self.position - self.look_at
    }

    /// Height of a picture that shows the whole volume from this direction.
    fn fitting_height_mm(&self, grid: &Grid, size_px: [u32; 2]) -> Result<f64, Problem> {
        let view = PlaneView { towards_eye: self.towards_eye(), up: self.up };
        view.fitting_height_mm(&grid.corners(), grid.center(), size_px).ok_or_else(|| {
            let detail = "the viewpoint shows nothing: viewpointposition is viewpointlookat, or viewpointup is along \
                          the viewing direction";
            Problem::new(axum::http::StatusCode::BAD_REQUEST, "malformed-parameter", detail)
                .with("path", "viewpointposition")
        })
    }

    /// A camera outside the volume in the viewpoint's direction.
    fn camera(&self, grid: &Grid, height_mm: f64) -> Value {
        let towards_eye = self.towards_eye();
        let distance_mm = towards_eye.length().max(2.0 * reach(grid, self.look_at));
        let eye = self.look_at + towards_eye * (distance_mm / towards_eye.length());
        json!({
            "eye_mm": eye.xyz.to_array(),
            "look_at_mm": self.look_at.xyz.to_array(),
            "up": self.up.xyz.to_array(),
            "projection": { "orthographic": { "height_mm": height_mm } },
        })
    }

    /// The slice through the point that is looked at.
    fn slice(&self, slab_mm: Option<f64>, method: Method, height_mm: f64) -> Value {
        let blend = match method {
            Method::Maximum => "mip",
            Method::Minimum => "minip",
            Method::Average | Method::VolumeRendered => "mean",
        };
        json!({
            "plane": { "normal": self.towards_eye().xyz.to_array(), "up": self.up.xyz.to_array() },
            "center_mm": self.look_at.xyz.to_array(),
            "slab_mm": slab_mm.unwrap_or(0.0),
            "blend": blend,
            "height_mm": height_mm,
        })
    }
}

/// Table K.1-1, with the values that the query left to the server.
fn module(
    reformat: Reformat,
    method: Method,
    viewpoint: Viewpoint,
    slab_mm: Option<f64>,
    window: Option<Window>,
) -> Value {
    let kind = match reformat {
        Reformat::ThreeD => "3D_RENDERING",
        Reformat::Mpr => "MPR",
    };
    let triple = |xyz: glam::DVec3| xyz.to_array().map(Value::from).to_vec();
    let mut attributes: Vec<(&str, &str, Vec<Value>)> = vec![
        ("00720510", "CS", vec![kind.into()]),
        ("0070120D", "CS", vec![method.word().to_uppercase().into()]),
        ("00701603", "FD", triple(viewpoint.position.xyz)),
        ("00701604", "FD", triple(viewpoint.look_at.xyz)),
        ("00701605", "FD", triple(viewpoint.up.xyz)),
    ];
    if let Some(mm) = slab_mm {
        attributes.push(("00701503", "FD", vec![mm.into()]));
    }
    if let Some(Window { center, width, shape }) = window {
        attributes.push(("00281056", "CS", vec![shape.function().into()]));
        attributes.push(("00281051", "DS", vec![width.into()]));
        attributes.push(("00281050", "DS", vec![center.into()]));
    }
    let members =
        attributes.into_iter().map(|(tag, vr, value)| (tag.to_owned(), json!({ "vr": vr, "Value": value })));
    Value::Object(members.collect::<Map<_, _>>())
}
