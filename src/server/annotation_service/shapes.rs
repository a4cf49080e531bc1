//! Surfaces of regions and meshes, ready to be drawn: made of their contents once, and kept as long
//! as there is room.

use std::sync::Arc;

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
            let known = self.shapes.lock().known.get(&key).cloned();
            let shape = match known {
                Some(shape) => shape,
                None => self.make(&key).await?,
            };
            found.known.insert(key, shape);
        }
        Ok(found)
    }

    /// Makes a surface and keeps it, even if the request that wants it ends before: the next one
    /// finds it, and does not start the same work again.
    async fn make(&self, key: &Key) -> Result<Option<Arc<SurfaceMesh>>, Problem> {
        // One at a time: a large label map takes all cores anyway.
        let turn = Arc::clone(&self.making).lock_owned().await;
        if let Some(known) = self.shapes.lock().known.get(key).cloned() {
            return Ok(known);
        }
        let (_, bytes) = self.store.content(&key.0).await?;
        let (key, cache) = (key.clone(), Arc::clone(&self.shapes));
        let job = tokio::task::spawn_blocking(move || {
            let _turn = turn;
            let made = shape_of_content(&bytes, key.1);
            if let Err(cause) = &made {
                tracing::warn!(%cause, "a region or mesh cannot be drawn");
            }
            let shape = made.ok().map(Arc::new);
            let mut cache = cache.lock();
            if cache.known.len() >= MOST {
                cache.known.clear();
            }
            cache.known.insert(key, shape.clone());
            shape
        });
        job.await.map_err(|panic| Problem::internal("making a surface", panic))
    }
}
