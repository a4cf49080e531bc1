//! Overlays in JSON, and their conversion to items. Positions in patient mm (LPS), colours
//! display-referred sRGB 0..1.

use serde::Deserialize;

use super::whole::Whole;
use crate::overlay::{Curve, Landmark, Line, Mesh, OverlayItem, Overlays, Radius, Text};
use relief_base::{OutOfRange, Patient, Point};

/// Radius of a landmark and width of lines where none is written, px.
const USUAL_RADIUS_PX: f64 = 6.0;
const USUAL_WIDTH_PX: f64 = 3.0;

/// Colours where none is written.
const LANDMARK_RGB: [f64; 3] = [1.0, 0.35, 0.25];
const LINE_RGB: [f64; 3] = [0.35, 0.85, 1.0];
const MESH_RGB: [f64; 3] = [0.45, 0.9, 0.5];
const TEXT_RGB: [f64; 3] = [1.0; 3];

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct OverlaysFile {
    items: Vec<ItemFile>,
    bounding_box: bool,
    orientation_cube: bool,
    scale_bar: bool,
    caption: bool,
    label_height_px: Option<Whole>,
    label_depths_mm: Option<[f64; 2]>,
    occluded: Option<f64>,
}

/// The one key that names the kind of the item.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
enum ItemFile {
    Landmark(LandmarkFile),
    Line(LineFile),
    Curve(CurveFile),
    Mesh(MeshFile),
    Text(TextFile),
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LandmarkFile {
    at_mm: [f64; 3],
    radius_mm: Option<f64>,
    radius_px: Option<f64>,
    rgb: Option<[f64; 3]>,
    label: Option<String>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LineFile {
    from_mm: [f64; 3],
    to_mm: [f64; 3],
    width_px: Option<f64>,
    rgb: Option<[f64; 3]>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CurveFile {
    points_mm: Vec<[f64; 3]>,
    #[serde(default)]
    closed: bool,
    #[serde(default)]
    smooth: bool,
    width_px: Option<f64>,
    rgb: Option<[f64; 3]>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct MeshFile {
    vertices_mm: Vec<[f64; 3]>,
    triangles: Vec<[Whole; 3]>,
    rgb: Option<[f64; 3]>,
    opacity: Option<f64>,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct TextFile {
    at_mm: [f64; 3],
    text: String,
    height_px: Option<Whole>,
    rgb: Option<[f64; 3]>,
}

impl OverlaysFile {
    /// The kinds of items, each the one key of an item.
    pub(super) const KINDS: [&str; 5] = ["landmark", "line", "curve", "mesh", "text"];

    /// Switches on the overlay `name`.
    ///
    /// # Errors
    /// When there is no overlay of this name.
    pub(super) fn switch_on(&mut self, name: &str) -> Result<(), OutOfRange> {
        match name {
            "bounding-box" => self.bounding_box = true,
            "cube" => self.orientation_cube = true,
            "scale-bar" => self.scale_bar = true,
            "caption" => self.caption = true,
            _ => return Err(OutOfRange::new("overlay", name, Overlays::switch_names())),
        }
        Ok(())
    }

    /// The overlays of a volume with this caption.
    pub(super) fn resolve(self, caption: impl FnOnce() -> String) -> Result<Overlays, OutOfRange> {
        // Before a list of another kind is made of it.
        if self.items.len() > Overlays::MAX_ITEMS {
            let found = format!("{} items", self.items.len());
            return Err(OutOfRange::new("overlays.items", found, format!("at most {}", Overlays::MAX_ITEMS)));
        }
        let items = self.items.into_iter().enumerate().map(|(index, item)| item.resolve(index));
        Ok(Overlays {
            items: items.collect::<Result<_, _>>()?,
            bounding_box: self.bounding_box,
            orientation_cube: self.orientation_cube,
            scale_bar: self.scale_bar,
            caption: self.caption.then(|| caption().into()),
            label_height_px: self.label_height_px.map(|height| height.0),
            label_depths_mm: self.label_depths_mm,
            occluded: self.occluded.unwrap_or(Overlays::DEFAULT_OCCLUDED),
        })
    }
}

impl ItemFile {
    fn resolve(self, index: usize) -> Result<OverlayItem, OutOfRange> {
        Ok(match self {
            Self::Landmark(landmark) => OverlayItem::Landmark(landmark.resolve(index)?),
            Self::Line(LineFile { from_mm, to_mm, width_px, rgb }) => OverlayItem::Line(Line {
                ends: [from_mm, to_mm].map(point),
                width_px: width_px.unwrap_or(USUAL_WIDTH_PX),
                rgb: rgb.unwrap_or(LINE_RGB),
            }),
            Self::Curve(CurveFile { points_mm, closed, smooth, width_px, rgb }) => {
                OverlayItem::Curve(Curve {
                    points: points_mm.into_iter().map(point).collect(),
                    closed,
                    smooth,
                    width_px: width_px.unwrap_or(USUAL_WIDTH_PX),
                    rgb: rgb.unwrap_or(LINE_RGB),
                })
            }
            Self::Mesh(MeshFile { vertices_mm, triangles, rgb, opacity }) => OverlayItem::Mesh(Mesh {
                vertices: vertices_mm.into_iter().map(point).collect(),
                triangles: triangles.into_iter().map(|corners| corners.map(|corner| corner.0)).collect(),
                rgb: rgb.unwrap_or(MESH_RGB),
                opacity: opacity.unwrap_or(1.0),
            }),
            Self::Text(TextFile { at_mm, text, height_px, rgb }) => {
                let height_px = height_px.map(|height| height.0);
                OverlayItem::Text(Text { at: point(at_mm), text, height_px, rgb: rgb.unwrap_or(TEXT_RGB) })
            }
        })
    }
}

impl LandmarkFile {
    fn resolve(self, index: usize) -> Result<Landmark, OutOfRange> {
        let Self { at_mm, radius_mm, radius_px, rgb, label } = self;
        let radius = match (radius_mm, radius_px) {
            (None, None) => Radius::Px(USUAL_RADIUS_PX),
            (Some(mm), None) => Radius::Mm(mm),
            (None, Some(px)) => Radius::Px(px),
            (Some(_), Some(px)) => {
                let path = format!("overlays.items[{index}].landmark.radius_px");
                return Err(OutOfRange::new(path, px, "nothing beside radius_mm"));
            }
        };
        let label = label.map(Into::into);
        Ok(Landmark { at: point(at_mm), radius, rgb: rgb.unwrap_or(LANDMARK_RGB), label })
    }
}

fn point(mm: [f64; 3]) -> Point<Patient> {
    Point::from_xyz(mm.into())
}

#[cfg(test)]
mod tests {
    use crate::SceneFile;
    use relief_volume::{Grid, Orbit};

    fn refused(overlays: &str) -> String {
        let grid = Grid::axis_aligned([10, 10, 10], [1.0; 3], [0.0; 3]).unwrap();
        let json = format!(r#"{{"overlays":{overlays}}}"#);
        let scene =
            SceneFile::parse(json.as_bytes()).and_then(|scene| scene.resolve(&grid, &Orbit::default()));
        scene.expect_err(overlays).to_string()
    }

    #[test]
    fn invalid_overlays_are_named_with_path_value_and_range() {
        let item = |item: &str| format!(r#"{{"items":[{{"landmark":{{"at_mm":[0,0,0]}}}},{item}]}}"#);
        let mesh = |rest: &str| {
            item(&format!(r#"{{"mesh":{{"vertices_mm":[[0,0,0],[1,0,0],[0,1,0]],"triangles":{rest}}}}}"#))
        };
        for (overlays, parts) in [
            (r#"{"occluded":1.5}"#.to_owned(), &["overlays.occluded is 1.5", "0 to 1"][..]),
            (r#"{"label_height_px":8}"#.to_owned(), &["overlays.label_height_px is 8", "12 to 96"]),
            (
                r#"{"label_depths_mm":[300,200]}"#.to_owned(),
                &["overlays.label_depths_mm is 300, 200", "the first not the larger"],
            ),
            (r#"{"compass":true}"#.to_owned(), &["overlays.compass", "unknown field"]),
            ("[true]".to_owned(), &["overlays: found an array"]),
            (item(r#"{"arrow":{}}"#), &["overlays.items[1]", "arrow", "landmark"]),
            (item("[[0,0,0]]"), &["overlays.items.1: found an array"]),
            (item(r#"{"text":[[0,0,0],"a"]}"#), &["overlays.items.1.text: found an array"]),
            (
                item(r#"{"landmark":{"at_mm":[0,2e6,0]}}"#),
                &["overlays.items[1].landmark.at_mm is 2000000", "-1000000 to 1000000 mm"],
            ),
            (
                item(r#"{"landmark":{"at_mm":[0,0,0],"radius_mm":1,"radius_px":2}}"#),
                &["overlays.items[1].landmark.radius_px is 2", "nothing beside radius_mm"],
            ),
            (
                item(r#"{"landmark":{"at_mm":[0,0,0],"radius_px":0.1}}"#),
                &["overlays.items[1].landmark.radius_px is 0.1", "0.5 to 500"],
            ),
            (
                item(r#"{"landmark":{"at_mm":[0,0,0],"label":""}}"#),
                &["overlays.items[1].landmark.label is 0 characters", "1 to 120"],
            ),
            (
                item(r#"{"text":{"at_mm":[0,0,0],"text":"a\nb"}}"#),
                &["overlays.items[1].text.text is a text with '\\n'", "one line"],
            ),
            (
                item(r#"{"text":{"at_mm":[0,0,0],"text":"a","height_px":97}}"#),
                &["overlays.items[1].text.height_px is 97", "12 to 96"],
            ),
            (
                item(r#"{"line":{"from_mm":[0,0,0],"to_mm":[1,1,1],"rgb":[0,0,2]}}"#),
                &["overlays.items[1].line.rgb is 2", "0 to 1"],
            ),
            (
                item(r#"{"curve":{"points_mm":[[0,0,0],[1,1,1]],"closed":true}}"#),
                &["overlays.items[1].curve.points_mm is 2 points", "at least 3"],
            ),
            (
                item(r#"{"curve":{"points_mm":[[0,0,0],[1,1e9,1]]}}"#),
                &["overlays.items[1].curve.points_mm[1] is 1000000000"],
            ),
            (mesh("[]"), &["overlays.items[1].mesh.triangles is empty"]),
            (mesh("[[0,1,2],[0,1,3]]"), &["overlays.items[1].mesh.triangles[1] is [0, 1, 3]", "0 to 2"]),
            (mesh("[[0,1,-2]]"), &["overlays.items[1].mesh.triangles[0][2]"]),
            (mesh(r#"[[0,1,2]],"opacity":0"#), &["overlays.items[1].mesh.opacity is 0", "0.05 to 1"]),
        ] {
            let message = refused(&overlays);
            for part in parts {
                assert!(message.contains(part), "{overlays}: {message:?} lacks {part:?}");
            }
        }
    }

    #[test]
    fn more_than_can_be_drawn_is_refused() {
        let many = |item: &str, count: usize| format!(r#"{{"items":[{}]}}"#, vec![item; count].join(","));
        let message = refused(&many(r#"{"landmark":{"at_mm":[0,0,0]}}"#, 20_001));
        assert!(message.contains("overlays.items is 20001 items"), "{message}");
        let long = format!(r#"{{"text":{{"at_mm":[0,0,0],"text":"{}"}}}}"#, "m".repeat(120));
        let message = refused(&many(&long, 834));
        assert!(message.contains("overlays.items[833].text.text is 100080 in all items"), "{message}");
    }
}
