//! Whether rays step over bricks in which nothing is visible.

/// Whether rays step over empty bricks. Both give the same bytes; only tests and measurements turn
/// it off.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EmptySpaceSkipping {
    /// Empty bricks are stepped over.
    #[default]
    On,
    /// Every sample is taken.
    Off,
}
