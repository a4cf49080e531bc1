//! Annotations over pictures: which items a picture shows to whom, and the shapes of those that are
//! surfaces.

use std::collections::BTreeSet;
use std::error::Error;
use std::sync::Arc;

use axum::http::HeaderMap;

use super::author::author_of;
use crate::annotation_service::{Annotations, Visible, of};
use crate::problem::Problem;
use crate::state::Pictures;
use relief_annotation::{Item, ShownSets};
use relief_render::Scene;
use relief_session::{DrawableSource, Drawables, DrawablesWanted, LeftOutCounts, VolumeEntry};

/// Adds the annotations that a scene requests to its overlays; `None` if it requests none.
///
/// # Errors
/// 404 where this server keeps none, and whatever the store says.
pub(crate) async fn draw(
    pictures: &Pictures,
    entry: &VolumeEntry,
    scene: &mut Scene,
    headers: &HeaderMap,
) -> Result<Option<LeftOutCounts>, Problem> {
    if scene.annotations.is_nothing() {
        return Ok(None);
    }
    let author = author_of(headers)?;
    let (annotations, shown) = (of(pictures.annotations.as_ref())?, &scene.annotations);
    let drawables = annotations.drawables_of(entry, shown, author.as_deref(), &BTreeSet::new()).await?;
    Ok(Some(drawables.draw(&mut scene.request, &scene.display, &entry.grid)))
}

impl Annotations {
    /// Drawables of those items of a volume that the author and all readers may see.
    pub(crate) async fn drawables_of(
        &self,
        entry: &VolumeEntry,
        shown: &ShownSets,
        author: Option<&str>,
        readers: &BTreeSet<String>,
    ) -> Result<Drawables, Problem> {
        let snapshot = self.snapshot(&entry.frame_of_reference()).await?;
        let of_readers = readers.iter().map(|reader| Visible::new(&snapshot.sets, Some(reader)));
        let all: Vec<_> = std::iter::once(Visible::new(&snapshot.sets, author)).chain(of_readers).collect();
        let is_visible = |set: &str| all.iter().all(|visible| visible.sees(set));
        let phase = entry.phase().map(|phase| phase.number);
        let is_drawn = |item: &Item| shown.has(&item.set) && is_visible(&item.set) && item.is_in_phase(phase);
        let items: Vec<&Item> =
            snapshot.items.iter().map(|known| &known.item).filter(|item| is_drawn(item)).collect();
        let shapes = self.shapes(&items).await?;
        Ok(Drawables::new(items, |geometry| shapes.of(geometry).map(Arc::clone)))
    }
}

impl DrawableSource for Annotations {
    fn revision(&self) -> u64 {
        self.changes()
    }

    async fn drawables(&self, wanted: &DrawablesWanted) -> Result<Drawables, Arc<dyn Error + Send + Sync>> {
        let DrawablesWanted { entry, shown, author, readers } = wanted;
        self.drawables_of(entry, shown, author.as_deref(), readers)
            .await
            .map_err(|problem| Arc::new(problem) as _)
    }
}
