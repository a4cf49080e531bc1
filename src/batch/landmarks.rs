//! Views of annotations: one for each landmark, looking along its normal, and those through the
//! cameras that placed it.
//!
//! The normal of a point is that of the surface it lies on: against the mean gradient of the values
//! in balls about it, towards lower values. Where there is no surface (less than
//! [`LEAST_SLOPE`]) it is looked at from where its placing camera was, and without one from
//! outside: from the volume's centre through it. A plane has its own normal, and of its two sides
//! the one that its camera was on, or the outer one. Patient LPS mm.

use std::collections::{BTreeSet, HashMap};

use glam::DVec3;
use serde_json::{Map, Value};

use super::views::View;
use relief_annotation::{CameraRecord, Geometry, Item, value_at};
use relief_base::{Patient, Point, Vector};
use relief_volume::{CameraFile, Orbit, ProjectionFile, Volume};

/// Mean gradient below which a point lies on no surface, HU per mm: thrice what noise of 30 HU
/// makes.
const LEAST_SLOPE: f64 = 15.0;
/// Radii of the balls whose mean gradient counts, mm; half as much again as voxels are long at
/// least.
const RADII_MM: [f64; 2] = [1.5, 3.0];
/// Height of a landmark's view at the landmark's depth at zoom 1, mm.
pub(crate) const LANDMARK_VIEW_MM: f64 = 160.0;
/// Most letters of an item's name in that of its view.
const LONGEST_NAME: usize = 40;

/// Directions of the 26-point rule of Lebedev on the sphere, exact to degree 7: to axes, edges and
/// corners of a cube, with weights.
const RULE: [f64; 3] = [1.0 / 21.0, 4.0 / 105.0, 9.0 / 280.0];

/// One view for each point and plane, along its normal. The orbit has zoom and field of view.
pub(super) fn landmark_views(items: &[&Item], volume: &Volume, orbit: &Orbit) -> Vec<View> {
    let names = ViewNames::new(items);
    let view = |item: &&Item| {
        let (at, towards_eye) = normal(item, volume)?;
        let camera = camera(at, towards_eye, volume, orbit);
        Some(view(names.of("landmark", item), "landmarks", &camera))
    };
    items.iter().filter_map(view).collect()
}

/// One view for each item that has the camera through which it was placed.
pub(super) fn camera_views(items: &[&Item]) -> Vec<View> {
    let names = ViewNames::new(items);
    let view = |item: &&Item| {
        let camera = written(item.placement.as_ref()?.camera.as_ref()?)?;
        Some(view(names.of("camera", item), "cameras", &camera))
    };
    items.iter().filter_map(view).collect()
}

fn view(name: String, group: &str, camera: &CameraFile) -> View {
    let mut scene = Map::new();
    scene.insert("camera".to_owned(), serde_json::to_value(camera).unwrap_or(Value::Null));
    View { name, group: group.to_owned(), scene, orbit: None }
}

/// A camera as it was recorded, if pictures can be made through it.
fn written(record: &CameraRecord) -> Option<CameraFile> {
    let projection = match (record.vertical_fov_deg, record.height_mm) {
        (Some(vertical_fov_deg), _) => ProjectionFile::Perspective { vertical_fov_deg },
        (None, Some(height_mm)) => ProjectionFile::Orthographic { height_mm },
        (None, None) => return None,
    };
    let CameraRecord { eye_mm, look_at_mm, up, .. } = *record;
    let camera = CameraFile { eye_mm, look_at_mm, up, projection, lens_shift: [0.0; 2] };
    camera.resolve().is_ok().then_some(camera)
}

/// The place of a landmark, and the side that it is seen from.
fn normal(item: &Item, volume: &Volume) -> Option<(Point<Patient>, Vector<Patient>)> {
    let seen_from = |at: Point<Patient>| {
        let camera = item.placement.as_ref()?.camera.as_ref()?;
        let [eye, look_at] = [camera.eye_mm, camera.look_at_mm].map(|mm| Point::from_xyz(mm.into()));
        // Eyes of parallel cameras say nothing but a direction.
        let from = if camera.vertical_fov_deg.is_some() { eye - at } else { eye - look_at };
        from.normalized()
    };
    let outside = |at: Point<Patient>| {
        (at - volume.grid().center()).normalized().unwrap_or(Vector::new(0.0, -1.0, 0.0))
    };
    match item.geometry.as_ref()? {
        Geometry::Point { at_mm } => {
            let at = *at_mm;
            let towards = surface_normal(volume, at).or_else(|| seen_from(at)).unwrap_or_else(|| outside(at));
            Some((at, towards))
        }
        Geometry::Plane { center_mm, normal, .. } => {
            let (at, normal) = (*center_mm, Vector::from_xyz((*normal).into()).normalized()?);
            let side = seen_from(at).unwrap_or_else(|| outside(at));
            Some((at, if normal.dot(side) < 0.0 { -normal } else { normal }))
        }
        _ => None,
    }
}

/// The direction from dense to less dense at a place of a surface. By Gauss's theorem the mean
/// gradient in a ball of radius R is 3/R times the mean, over its sphere, of the values times the
/// direction.
fn surface_normal(volume: &Volume, at: Point<Patient>) -> Option<Vector<Patient>> {
    let longest = volume.grid().spacing_mm().into_iter().fold(0.0, f64::max);
    let mut slope = DVec3::ZERO;
    for radius in RADII_MM.map(|mm| mm.max(1.5 * longest)) {
        for (direction, weight) in directions() {
            // Both ends of a diameter, or neither: a single end would bias the gradient.
            let ends = [direction, -direction].map(|to| value_at(volume, at + Vector::from_xyz(to * radius)));
            if let [Some(after), Some(before)] = ends {
                slope += direction * (weight * (after - before) / 2.0 * 3.0 / radius);
            }
        }
    }
    let slope = slope / RADII_MM.len() as f64;
    (slope.length() >= LEAST_SLOPE).then(|| Vector::from_xyz(-slope.normalize()))
}

fn directions() -> impl Iterator<Item = (DVec3, f64)> {
    let steps = [-1.0, 0.0, 1.0];
    let all = steps.into_iter().flat_map(move |x| {
        steps.into_iter().flat_map(move |y| steps.into_iter().map(move |z| DVec3::new(x, y, z)))
    });
    all.filter(|step| *step != DVec3::ZERO).map(|step| {
        let weight = match step.length_squared() {
            length if length < 1.5 => RULE[0],
            length if length < 2.5 => RULE[1],
            _ => RULE[2],
        };
        (step.normalize(), weight)
    })
}

/// As far away as cameras that circle the volume, with the landmark in the middle.
fn camera(at: Point<Patient>, towards_eye: Vector<Patient>, volume: &Volume, orbit: &Orbit) -> CameraFile {
    let radius = volume.grid().bounding_radius_mm();
    let half_fov = (orbit.vertical_fov_deg / 2.0).to_radians();
    let distance = if orbit.vertical_fov_deg > 0.0 { radius / half_fov.sin() } else { 3.0 * radius };
    let height_mm = LANDMARK_VIEW_MM / orbit.zoom;
    let projection = if orbit.vertical_fov_deg > 0.0 {
        let vertical_fov_deg = (2.0 * (height_mm / 2.0 / distance).atan()).to_degrees().clamp(0.1, 170.0);
        ProjectionFile::Perspective { vertical_fov_deg }
    } else {
        ProjectionFile::Orthographic { height_mm }
    };
    // Up is towards the head; seen from above or below, towards the front.
    let up = if towards_eye.xyz.z.abs() > 0.95 {
        [0.0, -towards_eye.xyz.z.signum(), 0.0]
    } else {
        [0.0, 0.0, 1.0]
    };
    let eye_mm = (at + towards_eye * distance).xyz.to_array();
    CameraFile { eye_mm, look_at_mm: at.xyz.to_array(), up, projection, lens_shift: [0.0; 2] }
}

/// The names of views of items: that of the item, with its set where there are several, and a
/// number where names are alike.
struct ViewNames(HashMap<String, String>);

impl ViewNames {
    fn new(items: &[&Item]) -> Self {
        let sets: BTreeSet<&str> = items.iter().map(|item| item.set.as_str()).collect();
        let (mut names, mut used) = (HashMap::new(), BTreeSet::new());
        for item in items {
            let mut plain = slug(&item.name);
            if plain.is_empty() {
                plain = item.id.to_string()[..8].to_owned();
            }
            let plain = if sets.len() > 1 { format!("{}-{plain}", slug(&item.set)) } else { plain };
            let numbered = (2..).map(|number| format!("{plain}-{number}"));
            let name = std::iter::once(plain.clone()).chain(numbered).find(|name| !used.contains(name));
            let name = name.unwrap_or(plain);
            used.insert(name.clone());
            names.insert(item.id.to_string(), name);
        }
        Self(names)
    }

    fn of(&self, kind: &str, item: &Item) -> String {
        let name = self.0.get(&item.id.to_string()).map_or("", String::as_str);
        format!("{kind}-{name}")
    }
}

/// Small letters, digits and hyphens of a name.
fn slug(name: &str) -> String {
    let letters = name
        .chars()
        .map(|letter| if letter.is_ascii_alphanumeric() { letter.to_ascii_lowercase() } else { '-' });
    let mut slug = String::new();
    for letter in letters.take(LONGEST_NAME) {
        if letter != '-' || !(slug.is_empty() || slug.ends_with('-')) {
            slug.push(letter);
        }
    }
    slug.trim_end_matches('-').to_owned()
}
