//! Surfaces of regions and meshes in memory.

use std::collections::HashMap;
use std::sync::Arc;

use parking_lot::{Mutex, MutexGuard};

use relief_annotation::{ContentId, Geometry};
use relief_session::SurfaceMesh;

/// The key of a surface: a content, and the label in it (0 for a mesh).
pub(super) type Key = (ContentId, u16);

/// The computed surfaces; `None` for contents without one.
#[derive(Default)]
pub(crate) struct Shapes {
    pub(super) known: HashMap<Key, Option<Arc<SurfaceMesh>>>,
}

impl Shapes {
    pub(crate) fn of(&self, geometry: &Geometry) -> Option<&Arc<SurfaceMesh>> {
        self.known.get(&key(geometry)?)?.as_ref()
    }
}

pub(super) fn key(geometry: &Geometry) -> Option<Key> {
    match geometry {
        Geometry::Region(region) => Some((region.content.clone(), region.label)),
        Geometry::Mesh(mesh) => Some((mesh.content.clone(), 0)),
        _ => None,
    }
}

/// Surfaces of earlier pictures.
#[derive(Default)]
pub(super) struct ShapeCache(Mutex<Shapes>);

impl ShapeCache {
    /// The value is whole between statements, so a panic elsewhere leaves it usable.
    pub(super) fn lock(&self) -> MutexGuard<'_, Shapes> {
        self.0.lock()
    }
}
