//! Units, spaces and small helpers.

mod space;
mod units;

pub use space::{Beacon, Patient, Point, Sensor, Space, Transform, Vector, View, Voxel};
pub use units::{DepthLimits, Disparity, ScaledDepth, ViewDepth};
