//! (to come)
/// (to come)
#[derive(Debug)]
pub struct BrickRanges;
/// (to come)
#[derive(Debug)]
pub struct DistanceMap;
