//! Annotations: what people say about places of a patient, and how that came about.
//!
//! What it is: [`Item`]s (landmarks, lines, angles, curves, planes, regions, meshes) in patient mm,
//! their [`measures`], and changes as values: an [`Edit`] requests changes, [`Event`]s record them.
//! Growing, painting and filling make regions; `mesh` makes surfaces of them; `placing` snaps
//! points, and `landmark_task` says which landmark is next. What it is not: storage (see `relief_store`), files (see `relief_exchange`) or drawing.
//!
//! Space: patient LPS, mm, of the item's frame of reference. Angles in degrees, areas in mm²,
//! volumes in ml.
//!
//! | word | meaning |
//! |---|---|
//! | item | one thing with a name and at most one geometry |
//! | set | the items of one reader or purpose; an item is in one |
//! | list | items of a set that belong together and have an order, such as the points of one file |
//! | edit | changes of one author that happen together or not at all, and are undone together |
//! | event | one change of one item as it was made; never altered afterwards |

mod change;
mod check;
mod curve;
mod geometry;
mod item;
mod landmark_task;
mod measure;
mod mesh;
mod patient_mm;
mod placement;
mod placing;
mod ready;
mod segmentation;
mod shown;
mod template;
mod time;

pub use change::{Author, Change, Edit, Event, EventKind, Versioned};
pub use curve::catmull_rom;
pub use geometry::{ContentId, Geometry, MeshSummary, RegionSummary};
pub use item::{Concept, FrameOfReference, Item, ItemId, Set, State};
pub use landmark_task::{HeldLandmark, LandmarkList, LandmarkTask};
pub use measure::{Measure, measures};
pub use placement::{CameraRecord, Device, Method, Placement};
pub use shown::{ShownSets, ShownSetsError};
pub use template::{Completeness, Expected, ExpectedKind, Template, TemplateError};
pub use time::Timestamp;

pub use mesh::files::{MeshFileError, MeshFilePlace, MeshFormat, ReadMesh, read_mesh, write_mesh};
pub use mesh::{Decimation, Measures, MeshError, Smoothing, TriangleMesh, surface_nets};
pub use placing::SnapError;
pub use placing::{Snap, SnapFeature, Snapped, snap_point, value_at};
pub use segmentation::{
    Contour, FillError, Grow, GrowError, GrowLimits, GrowProgress, GrowStage, GrownRegion, GrowthEnd,
    RefineStep, Stroke, fill_contours, grow_region, paint_strokes, refine_region,
};
