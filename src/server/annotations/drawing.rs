//! Annotations over pictures: which items a picture shows to whom, and the shapes of those that are
//! surfaces.

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
    let drawables =
        of(pictures.annotations.as_ref())?.drawables_of(entry, &scene.annotations, author.as_deref()).await?;
    Ok(Some(drawables.draw(&mut scene.request, &scene.display, &entry.grid)))
}

impl Annotations {
    /// The drawables of a volume's items for this author.
    pub(crate) async fn drawables_of(
        &self,
        entry: &VolumeEntry,
        shown: &ShownSets,
        author: Option<&str>,
    ) -> Result<Drawables, Problem> {
        let snapshot = self.snapshot(&entry.frame_of_reference()).await?;
        let visible = Visible::new(&snapshot.sets, author);
        let phase = entry.phase().map(|phase| phase.number);
        let is_drawn =
            |item: &Item| shown.has(&item.set) && visible.sees(&item.set) && item.is_in_phase(phase);
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
        let DrawablesWanted { entry, shown, author } = wanted;
        self.drawables_of(entry, shown, author.as_deref()).await.map_err(|problem| Arc::new(problem) as _)
    }
}
