//! The path tracer: light paths with one scattering or more, added up pass by pass on the GPU.
//!
//! [`PathTrace`] holds the settings of mode `path-traced`; the stage here runs them. The depth is
//! the ray caster's of the same request. After Kroes, Post and Botha, *Exposure Render* (PLoS ONE
//! 2012), with its hybrid of surface and volume scattering along stochastic paths.
//!
//! A picture is the mean of its passes and nothing else: the same request gives the same bytes,
//! whether its passes were made at once or as continuations of a picture with fewer. Light is
//! linear and becomes sRGB at the end. Spaces: view mm, voxel index; extinction per mm.

mod denoise;
mod medium;
mod settings;
mod stage;
mod sums;
mod tracer;
mod uniform;

pub use settings::PathTrace;
pub(super) use tracer::{PathTraceJob, PathTracer};
