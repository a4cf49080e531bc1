//! Units, spaces and small helpers.

pub mod space;
pub mod units;
