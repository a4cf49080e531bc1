//! Units, spaces, budgets of reading, and the helpers for files and texts that several crates use.

mod budget;
mod files;
mod out_of_range;
mod space;
mod text;
mod units;

pub use budget::{Budget, BudgetError};
pub use files::{FileId, read_at_most, sha256_of, sha256_of_file, shared_temporary, write_new, write_whole};
pub use out_of_range::OutOfRange;
pub use space::{Beacon, Patient, Point, Sensor, Space, Transform, Vector, View, Voxel};
pub use text::{csv_cell, of_csv_cell, printable};
pub use units::{DepthLimits, Disparity, ScaledDepth, ViewDepth};
