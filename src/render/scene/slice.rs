//! The slice of a scene as written in JSON, and the camera that sees it.
//!
//! Patient space (LPS), mm. The picture's orthographic camera follows from the slice, so a scene
//! has a camera or a slice, not both.

use serde::de::MapAccess;
use serde::de::value::MapAccessDeserializer;
use serde::{Deserialize, Deserializer};

use crate::mode::SlabBlend;
use relief_base::{OutOfRange, Patient, Point, Vector};
use relief_volume::{Camera, CameraError, Grid, NamedPlane, Orbit, PlaneView};

/// A slice through the volume: where, how thick and how large.
#[derive(Clone, Copy, Debug, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SliceFile {
    /// Its orientation, and the side that faces the eye.
    pub plane: SlicePlane,
    /// A point of the plane, in the middle of the picture; the volume's centre when left out.
    pub center_mm: Option<[f64; 3]>,
    /// Moves that point: towards the head (axial), the left (sagittal), the back (coronal), or
    /// along the normal.
    pub offset_mm: f64,
    /// Thickness of the slab, half of it on each side; 0 is a plane.
    pub slab_mm: f64,
    /// The one of the slab's values that is shown.
    #[serde(deserialize_with = "blend")]
    pub blend: SlabBlend,
    /// Height of the picture; when left out, it shows the whole volume.
    pub height_mm: Option<f64>,
    /// Whether the patient directions at the edges are burnt into the picture.
    pub letters: bool,
}

/// The plane of a slice.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum SlicePlane {
    /// A standard plane.
    Named(NamedPlane),
    /// Any plane.
    Oblique {
        /// Points from the plane to the eye.
        normal: [f64; 3],
        /// The direction that is up in the picture.
        up: [f64; 3],
    },
}

impl Default for SlicePlane {
    fn default() -> Self {
        Self::Named(NamedPlane::default())
    }
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct ObliqueFile {
    normal: [f64; 3],
    #[serde(default = "relief_volume::head_up")]
    up: [f64; 3],
}

/// Written by hand, since serde's untagged enums lose the error inside.
impl<'de> Deserialize<'de> for SlicePlane {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct NameOrDirections;
        impl<'de> serde::de::Visitor<'de> for NameOrDirections {
            type Value = SlicePlane;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(f, "axial, sagittal, coronal or {{\"normal\": [x, y, z], \"up\": [x, y, z]}}")
            }

            fn visit_str<E: serde::de::Error>(self, name: &str) -> Result<SlicePlane, E> {
                let unknown = || E::invalid_value(serde::de::Unexpected::Str(name), &self);
                NamedPlane::from_name(name).map(SlicePlane::Named).ok_or_else(unknown)
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<SlicePlane, A::Error> {
                let ObliqueFile { normal, up } = ObliqueFile::deserialize(MapAccessDeserializer::new(map))?;
                Ok(SlicePlane::Oblique { normal, up })
            }
        }
        deserializer.deserialize_any(NameOrDirections)
    }
}

fn blend<'de, D: Deserializer<'de>>(deserializer: D) -> Result<SlabBlend, D::Error> {
    let name = String::deserialize(deserializer)?;
    let names = SlabBlend::ALL.map(SlabBlend::name).join(", ");
    let unknown = || serde::de::Error::custom(format!("{name:?} is no blend, allowed: {names}"));
    SlabBlend::from_name(&name).ok_or_else(unknown)
}

impl SliceFile {
    /// Farthest that a slice's middle may be from the patient origin along an axis, and its largest
    /// offset, mm.
    const FARTHEST_MM: f64 = 1e5;

    /// The camera that sees the slice in a picture of this size.
    pub(super) fn camera(&self, grid: &Grid, size_px: [u32; 2]) -> Result<Camera, OutOfRange> {
        let (view, offset_axis) = self.plane.resolve()?;
        let center = self.center(grid)? + offset_axis * self.offset_mm;
        let corners = grid.corners();
        let fitting = view.fitting_height_mm(&corners, center, size_px);
        let height_mm = self.height_mm.or(fitting).unwrap_or(1.0); // without a fitting one the camera is refused
        // Outside the volume, whatever the slab: the eye's own place shows nowhere else.
        let reach = corners.into_iter().map(|corner| corner.distance(center)).fold(0.0, f64::max);
        view.camera(center, 2.0 * reach + self.slab_mm.clamp(0.0, Self::FARTHEST_MM), height_mm)
            .map_err(|error| self.blame(&error))
    }

    fn center(&self, grid: &Grid) -> Result<Point<Patient>, OutOfRange> {
        let far = Self::FARTHEST_MM;
        let within = |mm: f64| (-far..=far).contains(&mm);
        if !within(self.offset_mm) {
            return Err(OutOfRange::new("slice.offset_mm", self.offset_mm, format!("{} to {far}", -far)));
        }
        match self.center_mm {
            None => Ok(grid.center()),
            Some(center) if center.into_iter().all(within) => Ok(Point::from_xyz(center.into())),
            Some(center) => {
                let allowed = format!("{} to {far} mm each", -far);
                Err(OutOfRange::new("slice.center_mm", format!("{center:?}"), allowed))
            }
        }
    }

    /// Converts a camera's error to one of the slice.
    fn blame(&self, error: &CameraError) -> OutOfRange {
        match error {
            CameraError::NoUp(up) => {
                OutOfRange::new("slice.plane.up", format!("{up:?}"), "any direction across the normal")
            }
            CameraError::Height(mm) => OutOfRange::new("slice.height_mm", mm, "0.001 to 1000000"),
            other => OutOfRange::new("slice", other, "a plane within 1000000 mm of the patient origin"),
        }
    }
}

impl SlicePlane {
    /// How it is looked at, and the unit vector along which offsets count.
    fn resolve(self) -> Result<(PlaneView, Vector<Patient>), OutOfRange> {
        match self {
            Self::Named(plane) => Ok((plane.view(), plane.offset_axis())),
            Self::Oblique { normal, up } => {
                let direction = |key: &str, xyz: [f64; 3]| {
                    let vector = Vector::from_xyz(xyz.into());
                    let usable = xyz.iter().all(|part| part.abs() <= 1e6);
                    vector.normalized().filter(|_| usable).ok_or_else(|| {
                        let allowed = "a direction of length above zero, parts within 1000000";
                        OutOfRange::new(format!("slice.plane.{key}"), format!("{xyz:?}"), allowed)
                    })
                };
                let (towards_eye, up) = (direction("normal", normal)?, direction("up", up)?);
                Ok((PlaneView { towards_eye, up }, towards_eye))
            }
        }
    }
}

/// The slice of a scene in mode `slice`; nothing in other modes.
///
/// # Errors
/// When there is a slice in another mode, or another view beside a slice.
pub(super) fn expect_one_view(
    is_slice: bool,
    slice: Option<SliceFile>,
    has_camera: bool,
    orbit: &Orbit,
) -> Result<Option<SliceFile>, OutOfRange> {
    let refuse = |path: &str, found: &str, allowed: &str| Err(OutOfRange::new(path, found, allowed));
    match (is_slice, slice) {
        (false, None) => Ok(None),
        (false, Some(_)) => refuse("slice", "there", "in mode slice only"),
        (true, _) if has_camera => {
            refuse("camera", "there", "nothing in mode slice, whose camera follows from the slice")
        }
        (true, _) if *orbit != Orbit::default() => {
            refuse("slice", "beside a view by angles, zoom or field of view", "a slice or such a view")
        }
        (true, slice) => Ok(Some(slice.unwrap_or_default())),
    }
}

#[cfg(test)]
mod tests {
    use super::super::SceneFile;
    use super::*;
    use crate::mode::Mode;
    use crate::request::RenderRequest;
    use relief_volume::Projection;

    fn resolve(json: &str) -> Result<RenderRequest, String> {
        let grid = Grid::axis_aligned([11, 21, 31], [1.0; 3], [0.0; 3]).unwrap();
        let scene = SceneFile::parse(json.as_bytes()).and_then(|file| file.resolve(&grid, &Orbit::default()));
        scene.map(|scene| scene.request).map_err(|error| error.to_string())
    }

    #[test]
    fn a_slice_without_more_is_axial_through_the_centre_and_shows_the_whole_volume() {
        let request = resolve(r#"{"mode": "slice", "size_px": [100, 100]}"#).unwrap();
        assert_eq!(request.mode, Mode::Slice(SlabBlend::Mean));
        assert_eq!(request.camera.look_at().xyz.to_array(), [5.0, 10.0, 15.0]);
        assert_eq!(request.camera.projection(), Projection::Orthographic { height_mm: 21.0 });
        assert_eq!(
            (request.camera.edge_labels().right, request.camera.edge_labels().top),
            ("L".into(), "A".into())
        );
        let (black, white) = (request.transfer.at(-160.0), request.transfer.at(240.0));
        assert_eq!((black, white), ([0.0, 0.0, 0.0, 1.0], [1.0; 4]), "window 40, 400 in opaque grey");
    }

    #[test]
    fn offsets_follow_the_patient_axes_and_oblique_normals() {
        for (plane, middle) in [
            (r#""axial""#, [5.0, 10.0, 17.0]),
            (r#""sagittal""#, [7.0, 10.0, 15.0]),
            (r#""coronal""#, [5.0, 12.0, 15.0]),
            (r#"{"normal": [0, 0, -3], "up": [0, -1, 0]}"#, [5.0, 10.0, 13.0]),
        ] {
            let json = format!(r#"{{"mode": "slice", "slice": {{"plane": {plane}, "offset_mm": 2}}}}"#);
            assert_eq!(resolve(&json).unwrap().camera.look_at().xyz.to_array(), middle, "{plane}");
        }
    }

    #[test]
    fn invalid_slices_are_named_with_path_value_and_range() {
        let slice = |slice: &str| format!(r#"{{"mode": "slice", "slice": {slice}}}"#);
        for (json, parts) in [
            (
                slice(r#"{"plane": "transverse"}"#),
                &["slice.plane", "transverse", "axial, sagittal, coronal"][..],
            ),
            (slice(r#"{"plane": [0, 0, 1]}"#), &["slice.plane", "sequence"]),
            (
                slice(r#"{"plane": {"normal": [0, 0, 0]}}"#),
                &["slice.plane.normal is [0.0, 0.0, 0.0]", "length"],
            ),
            (slice(r#"{"plane": {"normal": [0, 0, 1]}}"#), &["slice.plane.up is", "across the normal"]),
            (slice(r#"{"plane": {"normal": [0, 1, 1], "tilt": 3}}"#), &["slice.plane", "tilt"]),
            (slice(r#"{"center_mm": [0, 1e7, 0]}"#), &["slice.center_mm is", "-100000 to 100000"]),
            (slice(r#"{"offset_mm": -2e5}"#), &["slice.offset_mm is -200000", "-100000 to 100000"]),
            (slice(r#"{"slab_mm": -1}"#), &["slice.slab_mm is -1", "0 to 1000"]),
            (slice(r#"{"blend": "median"}"#), &["slice.blend", "median", "mean, mip, minip"]),
            (slice(r#"{"height_mm": 0}"#), &["slice.height_mm is 0", "0.001 to"]),
            (slice(r#"{"thickness": 1}"#), &["slice", "thickness", "unknown field"]),
            (slice("[]"), &["slice: found an array"]),
            (r#"{"slice": {}}"#.to_owned(), &["slice is there", "mode slice"]),
            (
                r#"{"mode": "slice", "camera": {"eye_mm": [0,-9,0], "look_at_mm": [0,0,0],
                    "projection": {"orthographic": {"height_mm": 9}}}}"#
                    .to_owned(),
                &["camera is there", "mode slice"],
            ),
        ] {
            let message = resolve(&json).expect_err(&json);
            for part in parts {
                assert!(message.contains(part), "{json}: {message:?} lacks {part:?}");
            }
        }
    }

    #[test]
    fn a_slice_and_a_view_by_angles_exclude_each_other() {
        let grid = Grid::axis_aligned([4; 3], [1.0; 3], [0.0; 3]).unwrap();
        let turned = Orbit { azimuth_deg: 10.0, ..Orbit::default() };
        let scene = SceneFile::parse(br#"{"mode": "slice"}"#).unwrap().resolve(&grid, &turned);
        assert!(scene.unwrap_err().to_string().contains("slice is beside a view by angles"));
    }
}
