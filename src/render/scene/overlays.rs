//! Overlays as written in JSON, and what they become. Positions in patient mm (LPS), colours display-referred sRGB 0..1.

use serde::Deserialize;

use crate::render::overlay::{Curve, Landmark, Line, Mesh, OverlayItem, Overlays, Radius};
use crate::render::request::RequestError;
use crate::space::{Patient, Point};

/// Radius of a landmark and width of lines where none is written, px.
const USUAL_RADIUS_PX: f64 = 6.0;
const USUAL_WIDTH_PX: f64 = 3.0;

/// Colours where none is written.
const LANDMARK_RGB: [f64; 3] = [1.0, 0.35, 0.25];
const LINE_RGB: [f64; 3] = [0.35, 0.85, 1.0];
const MESH_RGB: [f64; 3] = [0.45, 0.9, 0.5];

#[derive(Clone, Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct OverlaysFile {
    items: Vec<ItemFile>,
    bounding_box: bool,
    occluded: Option<f64>,
}

/// One key that says what the item is.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "snake_case")]
enum ItemFile {
    Landmark(LandmarkFile),
    Line(LineFile),
    Curve(CurveFile),
    Mesh(MeshFile),
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct LandmarkFile {
    at_mm: [f64; 3],
    radius_mm: Option<f64>,
    radius_px: Option<f64>,
    rgb: Option<[f64; 3]>,
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
    triangles: Vec<[u32; 3]>,
    rgb: Option<[f64; 3]>,
    opacity: Option<f64>,
}

impl OverlaysFile {
    /// The kinds of items, each the one key of an item.
    pub(super) const KINDS: [&str; 4] = ["landmark", "line", "curve", "mesh"];

    /// Switches on what `name` says.
    ///
    /// # Errors
    /// When there is no overlay of this name.
    pub(super) fn switch_on(&mut self, name: &str) -> Result<(), RequestError> {
        match name {
            "bounding-box" => self.bounding_box = true,
            _ => return Err(RequestError::new("overlay", &name, &Overlays::switch_names())),
        }
        Ok(())
    }

    pub(super) fn resolve(self) -> Result<Overlays, RequestError> {
        // Before a list of another kind is made of it.
        if self.items.len() > Overlays::MAX_ITEMS {
            let found = format!("{} items", self.items.len());
            return Err(RequestError::new(
                "overlays.items",
                &found,
                &format!("at most {}", Overlays::MAX_ITEMS),
            ));
        }
        let items = self.items.into_iter().enumerate().map(|(index, item)| item.resolve(index));
        Ok(Overlays {
            items: items.collect::<Result<_, _>>()?,
            bounding_box: self.bounding_box,
            occluded: self.occluded.unwrap_or(Overlays::DEFAULT_OCCLUDED),
        })
    }
}

impl ItemFile {
    fn resolve(self, index: usize) -> Result<OverlayItem, RequestError> {
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
                triangles,
                rgb: rgb.unwrap_or(MESH_RGB),
                opacity: opacity.unwrap_or(1.0),
            }),
        })
    }
}

impl LandmarkFile {
    fn resolve(self, index: usize) -> Result<Landmark, RequestError> {
        let Self { at_mm, radius_mm, radius_px, rgb } = self;
        let radius = match (radius_mm, radius_px) {
            (None, None) => Radius::Px(USUAL_RADIUS_PX),
            (Some(mm), None) => Radius::Mm(mm),
            (None, Some(px)) => Radius::Px(px),
            (Some(_), Some(px)) => {
                let path = format!("overlays.items[{index}].landmark.radius_px");
                return Err(RequestError::new(&path, &px, "nothing beside radius_mm"));
            }
        };
        Ok(Landmark { at: point(at_mm), radius, rgb: rgb.unwrap_or(LANDMARK_RGB) })
    }
}

fn point(mm: [f64; 3]) -> Point<Patient> {
    Point::from_xyz(mm.into())
}
