//! The keys that are read and written.

use serde::{Deserialize, Serialize};

use super::super::extra::Extra;

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Annotation {
    #[serde(rename = "annotationUID", default, skip_serializing_if = "Option::is_none")]
    pub(super) annotation_uid: Option<String>,
    #[serde(default)]
    pub(super) highlighted: bool,
    #[serde(default)]
    pub(super) is_locked: bool,
    #[serde(default = "yes")]
    pub(super) is_visible: bool,
    /// Whether its statistics are to be computed again.
    #[serde(default = "yes")]
    pub(super) invalidated: bool,
    pub(super) metadata: Metadata,
    pub(super) data: Data,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) relief: Option<Box<Extra>>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Metadata {
    pub(super) tool_name: String,
    #[serde(rename = "FrameOfReferenceUID", default, skip_serializing_if = "Option::is_none")]
    pub(super) frame_of_reference_uid: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) view_plane_normal: Option<[f64; 3]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) view_up: Option<[f64; 3]>,
}

#[derive(Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Data {
    #[serde(default)]
    pub(super) label: Option<String>,
    /// The label of an arrow; other tools use `label`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) text: Option<String>,
    #[serde(default)]
    pub(super) handles: Handles,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) contour: Option<Contour>,
    #[serde(default, skip_deserializing, skip_serializing_if = "Option::is_none")]
    pub(super) spline: Option<Spline>,
    /// Filled by Cornerstone.
    #[serde(default, skip_deserializing)]
    pub(super) cached_stats: EmptyObject,
}

#[derive(Default, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Handles {
    #[serde(default)]
    pub(super) points: Vec<[f64; 3]>,
    #[serde(default, skip_deserializing)]
    pub(super) active_handle_index: Option<u32>,
    #[serde(default, skip_deserializing)]
    pub(super) text_box: TextBox,
}

/// Text positions of the statistics; tools read this key without checking that it exists.
#[derive(Default, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct TextBox {
    pub(super) has_moved: bool,
    pub(super) world_position: [f64; 3],
    pub(super) world_bounding_box: Corners,
}

#[derive(Default, Serialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Corners {
    pub(super) top_left: [f64; 3],
    pub(super) top_right: [f64; 3],
    pub(super) bottom_left: [f64; 3],
    pub(super) bottom_right: [f64; 3],
}

#[derive(Default, Serialize)]
pub(super) struct EmptyObject {}

#[derive(Serialize, Deserialize)]
pub(super) struct Contour {
    #[serde(default)]
    pub(super) polyline: Vec<[f64; 3]>,
    #[serde(default)]
    pub(super) closed: bool,
}

#[derive(Serialize)]
pub(super) struct Spline {
    #[serde(rename = "type")]
    pub(super) kind: &'static str,
    pub(super) resolution: u32,
}

/// A file with a list of annotations.
#[derive(Deserialize)]
pub(super) struct AnnotationList {
    pub(super) annotations: Vec<Annotation>,
}

fn yes() -> bool {
    true
}
