//! Close codes of a live session.

pub(super) const GOING_AWAY: u16 = 1001;

pub(super) const POLICY: u16 = 1008;

pub(super) const INTERNAL: u16 = 1011;

pub(super) const TAKEN_OVER: u16 = 4001;

pub(super) const REMOVED: u16 = 4002;

/// Close code and reason; `None` if the connection is gone.
pub(super) type End = Option<(u16, &'static str)>;
