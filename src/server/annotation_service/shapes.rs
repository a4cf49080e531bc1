//! Surfaces of regions and meshes, ready to be drawn: made of their contents once, and kept as long
//! as there is room.

use std::sync::{Arc, PoisonError};

use super::service::Annotations;
use super::shape_cache::{Key, Shapes, key};
use crate::problem::Problem;
use relief_annotation::Item;
use relief_session::{SurfaceMesh, shape_of_content};

/// Surfaces that are kept: some hundred MB at most.
const MOST: usize = 128;

impl Annotations {
    /// The surfaces of these items. A content that cannot be read has none: the error is logged,
    /// and the other items are drawn.
    pub(crate) async fn shapes(&self, items: &[&Item]) -> Result<Shapes, Problem> {
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
