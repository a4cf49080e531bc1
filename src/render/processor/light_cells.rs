//! Light in cells of a coarse grid over the volume, as rays look it up; `illuminate` fills it.

use std::sync::Arc;

use super::super::light::Light;

/// The light in the cells of a volume that a request looks up.
#[derive(Clone, Default)]
pub(super) struct LightCells {
    /// The share of each light that reaches a cell.
    pub(super) shadows: Option<Arc<[[f32; Light::MAX]]>>,
    /// The share of all directions that is open around a cell.
    pub(super) openness: Option<Arc<[f32]>>,
}

impl LightCells {
    /// Bytes of the cells.
    pub(super) fn bytes(&self) -> u64 {
        let shadows = self.shadows.as_ref().map_or(0, |cells| size_of_val(&**cells));
        (shadows + self.openness.as_ref().map_or(0, |cells| size_of_val(&**cells))) as u64
    }
}
