//! The renderer: a [`RenderRequest`] and a volume become a [`RenderedFrame`] with colour and view
//! depth.
//!
//! The passes on the GPU, overlays, the JSON form of requests, and [`render_reference`], an f64
//! counterpart of the shaders on the CPU. Display formats are in `relief_display`; queues and
//! networks are elsewhere.
//!
//! Spaces: rays start in view space (mm) and sample in voxel indices. Depth is view depth in mm.
//!
//! **A picture.** One invocation casts one pixel, in tiles of 8x8. Rays start where they enter the
//! box of voxel centres; every sample position is computed from its number, never accumulated.
//! Software adapters render bands of rows, so that a request can be cancelled between two bands; the
//! ray caster on the processor deals rows to its threads, and asks between them. No pixel depends on
//! its band. Only tiles in which visible bricks can be seen are cast.
//!
//! **Empty space.** Bricks of 4³ cells keep their smallest and largest HU. For a transfer function,
//! a map holds the distance in bricks to the nearest visible one, and rays skip whole numbers of
//! samples: the remaining samples are those that would be taken without skipping, so the bytes are
//! the same. A ray ends when 1/512 of its light is left.
//!
//! **Voxels** are 16-bit signed normalised 3D textures where the adapter has them (every HU exact),
//! else half floats. Gradients are central differences along the patient axes, computed at upload
//! and stored next to the value. Volumes of more than 2^27 voxels are lit by six fetches instead.
//!
//! **Overlays** are drawn on the CPU in f64, so that their bytes do not depend on the adapter.
//! **Shadows and occlusion** are looked up in a coarse grid of cells, which is computed once per
//! volume, transfer function and light. **The path tracer** uses delta tracking with a majorant for
//! each brick; its random numbers are hashes of pixel, pass and seed.

mod appearance;
mod bands;
mod calibrate;
mod chosen;
mod classification;
mod cut;
mod depth_rule;
mod detail;
mod display_depth;
mod emptiness;
mod enlarge;
mod error;
mod fingerprint;
mod for_views;
mod frame;
mod framing;
mod gpu;
mod gpu_rays;
mod gradients;
mod illumination;
mod interest;
mod label_maps;
mod labels;
mod letters;
mod light;
mod lighting;
mod limits;
mod mode;
mod overlay;
mod pathtrace;
mod pipelines;
mod preparation;
mod processor;
mod quality;
mod refine;
mod region;
mod renderer;
mod request;
mod scene;
mod skipping;
mod slices;
mod store;
mod surface;
mod table_mark;
mod table_rule;
mod table_storage;
mod tables;
mod target;
mod texture;
mod true_views;
mod uniform;
mod upload;
mod validation;
mod view_synthesis;
mod volume_plan;
mod watch;

pub use crate::volume_plan::{VolumeLimits, VolumePlan};
pub use chosen::ChosenBlocks;
pub use classification::{Classification, UnknownClassification};
pub use cut::{CutChoice, CutFaces};
pub use depth_rule::{DepthRule, DepthRuleEntry};
pub use detail::Detail;
pub use display_depth::ForViews;
pub use emptiness::{EmptyCause, PictureWarning};
pub use error::RenderError;
pub use frame::{BackLayer, RenderedFrame, Timings};
pub use framing::{FramingRule, TISSUE_VIEW, framing_of_tissue};
pub use illumination::{Illumination, Occlusion};
pub use labels::{Edges, Labels, Look};
pub use light::{Light, Placement};
pub use lighting::Lighting;
pub use limits::depth_limits;
pub use mode::{Mode, SlabBlend, UnknownMode};
pub use overlay::{
    CAPITAL, TextMask, draw_overlays, label_height_px, label_stroke_px, lettering, text_margin_px, text_mask,
};
pub use overlay::{Curve, Landmark, Line, Mesh, OverlayItem, Overlays, Radius, Text, length_words};
pub use pathtrace::PathTrace;
pub use preparation::{Preparation, PreparedVolume};
pub use processor::{left_by_processor, render_reference};
pub use quality::Quality;
pub use refine::Refinement;
pub use renderer::Renderer;
pub use request::{Clip, ClipPlane, ClipSphere, RenderRequest, Shading};
pub use scene::{
    Scene, SceneError, SceneFile, SliceFile, SlicePlane, Subject, SubjectContent, SyntaxError, name_of,
    preset_json, shading_json, transfer_json, with_hash,
};
pub use skipping::EmptySpaceSkipping;
pub use store::MemoryUse;
pub use surface::Surface;
pub use table_rule::TableRule;
pub use true_views::{TrueViewsError, eye_cameras, true_views, with_span_of_cone};
pub use view_synthesis::{ViewSynthesizer, view_synthesizer};
pub use watch::Progress;

pub use gpu::{
    AdapterChoice, AdapterDescription, AdapterKind, Gpu, GpuError, GpuLimits, StallError, ValidationError,
    adapters,
};
