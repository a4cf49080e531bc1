//! Relief: headless CT volume rendering, in colour and depth, for glasses-free 3D displays.
//!
//! This library loads a CT series, renders it with a view depth for every pixel, encodes the result
//! for a display, and reads and writes annotations. It re-exports about forty names of the crates
//! below; depend on those crates for the rest.
//!
//! ```no_run
//! use relief::{
//!     AdapterChoice, FileFormat, Gpu, Orbit, Product, Renderer, SceneFile, Strictness, Subject, discover,
//!     encode, load,
//! };
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // Load the only series of a folder.
//! let found = discover("ct-series".as_ref(), Strictness::Lenient, &|_| ())?;
//! let volume = load(found.select(None)?, Strictness::Lenient, &|_| ())?.volume;
//!
//! // Render bone from the left, in colour and depth.
//! let scene = SceneFile::parse(br#"{ "transfer": { "preset": "bone" }, "display": { "layout": "wowvx" } }"#)?;
//! let orbit = Orbit { azimuth_deg: 90.0, ..Orbit::default() };
//! let scene = scene.resolve_for(&Subject::of(&volume, None), &orbit)?;
//! let mut renderer = Renderer::new(Gpu::open(&AdapterChoice::Best)?)?;
//! let frame = renderer.render(&volume, &scene.request)?;
//!
//! // Encode it as a 2D-plus-depth frame.
//! std::fs::write("frame.png", encode(&frame, &scene.display, Product::Frame, FileFormat::Png)?)?;
//! # Ok(()) }
//! ```
//!
//! | crate | content |
//! |---|---|
//! | `relief_base` | units, spaces, helpers |
//! | `relief_volume` | volumes, label maps, transfer functions, cameras, phantoms |
//! | `relief_dicom` | DICOM series and objects; NIfTI and NRRD |
//! | `relief_render` | the GPU renderer and its f64 reference |
//! | `relief_display` | display formats: frames, disparity, views |
//! | `relief_annotation`, `relief_store`, `relief_exchange` | annotations, their log, files of other programs |
//! | `relief_tracking`, `relief_live` | the Wiimote; the live protocol and its intents |
//! | `relief_session`, `relief_server`, `relief_client`, `relief_batch` | live views, HTTP, thin client, batches |
//! | `relief_study`, `relief_golden`, `relief_cli` | studies, golden images, the command line |

// Load.
pub use relief_dicom::{
    Discovery, LoadLimits, Loaded, Strictness, discover, load, load_within, read_labels, read_volume,
};
pub use relief_volume::{Grid, LabelMap, Phantom, PhantomKind, PhantomRecipe, Volume};
// Render.
pub use relief_base::{DepthLimits, Patient, Point, Vector, ViewDepth};
pub use relief_render::{
    AdapterChoice, DepthRule, Gpu, Mode, RenderRequest, RenderedFrame, Renderer, Scene, SceneFile, Subject,
};
pub use relief_volume::{Camera, Orbit, PRESETS, Projection, TransferFunction};
// Encode.
pub use relief_display::{DisplaySettings, Frame, Layout};
pub use relief_session::{FileFormat, Product, encode};
// Annotate.
pub use relief_annotation::{Change, Edit, FrameOfReference, Geometry, Item, ItemId, Set};
pub use relief_exchange::{Format, read as read_annotations, write as write_annotations};
pub use relief_store::Store;
