//! Rendering: a [`RenderRequest`] and a volume become a [`RenderedFrame`].
//!
//! What it is: the passes that run on the GPU, the JSON form of requests, and [`mod@reference`], an f64 twin of the
//! shaders on the CPU. What it is not: it knows no display format (see `display`) and no network.
//!
//! Spaces: rays start in view space (mm) and sample in voxel indices. Depth is view depth in mm.

mod bands;
mod calibrate;
mod classification;
mod depth_rule;
mod enlarge;
mod error;
mod fingerprint;
mod frame;
mod gpu;
mod gradients;
mod illumination;
mod label_maps;
mod labels;
mod letters;
mod light;
mod lighting;
mod mode;
mod overlay;
mod pathtrace;
mod pipelines;
mod reference;
mod region;
mod renderer;
mod request;
mod scene;
mod slices;
mod store;
mod surface;
mod tables;
mod uniform;
mod upload;
mod watch;

pub use classification::Classification;
pub use depth_rule::{DepthRule, DepthRuleEntry};
pub use error::RenderError;
pub use frame::{BackLayer, RenderedFrame, Timings};
pub use illumination::{Illumination, Occlusion};
pub use labels::{Edges, Labels, Look};
pub use light::{Light, Placement};
pub use lighting::Lighting;
pub use mode::{Mode, SlabBlend};
pub use overlay::{CAPITAL, draw_overlays, label_height_px, label_stroke_px, lettering};
pub use overlay::{Curve, Landmark, Line, Mesh, OverlayItem, Overlays, Radius, Text};
pub use pathtrace::PathTrace;
pub use renderer::{Renderer, Skipping, depth_limits};
pub use request::{Clip, ClipPlane, ClipSphere, RenderRequest, RequestError, Shading};
pub use scene::{
    Scene, SceneError, SceneFile, SliceFile, SlicePlane, preset_json, shading_json, transfer_json,
};
pub use store::{MemoryUse, VolumeLimits, VolumePlan};
pub use surface::Surface;
pub use watch::Progress;

pub use gpu::{AdapterChoice, AdapterDescription, AdapterKind, Gpu, GpuError, GpuLimits, adapters};
pub use reference::render_reference;
