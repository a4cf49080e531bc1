//! Surfaces of regions and meshes, ready to be drawn: made of their contents once, and kept as long
//! as there is room.

use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

use super::Annotations;
use crate::problem::Problem;
use relief_annotation::{ContentId, Geometry, Item};
use relief_session::{SurfaceMesh, shape_of_content};

/// Surfaces that are kept: some hundred MB at most.
const MOST: usize = 128;

/// The key of a surface: a content, and the label in it (0 for a mesh).
type Key = (ContentId, u16);

/// The computed surfaces; `None` for contents without one.
#[derive(Default)]
pub(super) struct Shapes {
    known: HashMap<Key, Option<Arc<SurfaceMesh>>>,
}

impl Shapes {
    pub(super) fn of(&self, geometry: &Geometry) -> Option<&Arc<SurfaceMesh>> {
        self.known.get(&key(geometry)?)?.as_ref()
    }
}

fn key(geometry: &Geometry) -> Option<Key> {
    match geometry {
        Geometry::Region(region) => Some((region.content.clone(), region.label)),
        Geometry::Mesh(mesh) => Some((mesh.content.clone(), 0)),
        _ => None,
    }
}

/// Surfaces of earlier pictures.
#[derive(Default)]
pub(super) struct ShapeCache(Mutex<Shapes>);

impl Annotations {
    /// The surfaces of these items. A content that cannot be read has none: the error is logged,
    /// and the other items are drawn.
    pub(super) async fn shapes(&self, items: &[&Item]) -> Result<Shapes, Problem> {
        let mut found = Shapes::default();
        for item in items.iter().filter(|item| item.visible) {
            let Some(geometry) = &item.geometry else { continue };
            let Some(key) = key(geometry).filter(|key| !found.known.contains_key(key)) else { continue };
            let known = self.shape_cache().known.get(&key).cloned();
            let shape = match known {
                Some(shape) => shape,
                None => self.make(&key).await?,
            };
            found.known.insert(key, shape);
        }
        Ok(found)
    }

    async fn make(&self, key: &Key) -> Result<Option<Arc<SurfaceMesh>>, Problem> {
        // One at a time: a large label map takes all cores anyway.
        let _turn = self.making.lock().await;
        if let Some(known) = self.shape_cache().known.get(key).cloned() {
            return Ok(known);
        }
        let (_, bytes) = self.store.content(&key.0).await?;
        let label = key.1;
        let job = tokio::task::spawn_blocking(move || shape_of_content(&bytes, label));
        let made = job.await.map_err(|panic| Problem::internal("making a surface", panic))?;
        if let Err(cause) = &made {
            tracing::warn!(%cause, "a region or mesh cannot be drawn");
        }
        let shape = made.ok().map(Arc::new);
        let mut cache = self.shape_cache();
        if cache.known.len() >= MOST {
            cache.known.clear();
        }
        cache.known.insert(key.clone(), shape.clone());
        Ok(shape)
    }

    fn shape_cache(&self) -> std::sync::MutexGuard<'_, Shapes> {
        // The value is whole between statements, so a panic elsewhere leaves it usable.
        self.shapes.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
