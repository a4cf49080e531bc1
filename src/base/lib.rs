//! Units, spaces, and the file helpers that several crates use.

mod files;
mod space;
mod units;

pub use files::{read_at_most, sha256_of, sha256_of_file, shared_temporary, write_whole};
pub use space::{Beacon, Patient, Point, Sensor, Space, Transform, Vector, View, Voxel};
pub use units::{DepthLimits, Disparity, ScaledDepth, ViewDepth};
