//! The log of annotations that a batch is planned with: the items of a series, and their shapes.

use std::path::PathBuf;
use std::sync::Arc;

use super::annotations::KeptAnnotations;
use super::error::{AnnotationsError, PlanError, SkipReason};
use relief_annotation::{FrameOfReference, Geometry, Item, ShownSets};
use relief_session::{SurfaceMesh, shape_of_content};
use relief_store::{Filter, Store, StoreError};

/// The items of a log that are drawn, and the folder that they are kept in.
pub struct AnnotationLog {
    runtime: tokio::runtime::Runtime,
    log: Store,
    items: Vec<Item>,
    folder: PathBuf,
}

impl std::fmt::Debug for AnnotationLog {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("AnnotationLog").field("items", &self.items.len()).finish_non_exhaustive()
    }
}

/// Volumes without a frame of reference have their own content's hash in its place.
const OF_VOLUME: &str = "volume:";

impl AnnotationLog {
    /// Reads the items of a log: those of `shown`; blinded sets must be named. Files of drawn
    /// annotations are written into `folder`.
    ///
    /// # Errors
    /// When the log cannot be read, or has no set of a name.
    pub fn open(place: &str, shown: &ShownSets, folder: PathBuf) -> Result<Self, PlanError> {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build();
        let runtime = runtime.map_err(AnnotationsError::System)?;
        let read = async {
            let log = Store::open_existing(place).await?;
            let sets = log.sets().await?;
            let items = log.list(&Filter::default()).await?.items;
            Ok::<_, StoreError>((log, sets, items))
        };
        let (log, sets, items) = runtime.block_on(read).map_err(AnnotationsError::Store)?;
        if let ShownSets::Sets(names) = shown
            && let Some(name) = names.iter().find(|name| !sets.iter().any(|set| set.name == **name))
        {
            return Err(AnnotationsError::NoSet { name: name.clone() }.into());
        }
        let is_named = matches!(shown, ShownSets::Sets(_));
        let is_blinded = |name: &str| sets.iter().any(|set| set.blinded && set.name == name);
        let is_wanted = |item: &Item| {
            shown.has(&item.set)
                && (is_named || !is_blinded(&item.set))
                && item.visible
                && item.geometry.is_some()
        };
        let items = items.into_iter().map(|known| known.item).filter(is_wanted).collect();
        Ok(Self { runtime, log, items, folder })
    }

    /// Whether some items refer to the content of a volume, so that its hash is needed.
    pub(super) fn has_items_of_volumes(&self) -> bool {
        let of_volume = |item: &Item| {
            item.frame_of_reference.as_ref().is_some_and(|frame| frame.0.starts_with(OF_VOLUME))
        };
        self.items.iter().any(of_volume)
    }

    /// The items of this frame of reference, in the log's order.
    pub(super) fn items_of(&self, frame: &FrameOfReference) -> Vec<&Item> {
        self.items.iter().filter(|item| item.frame_of_reference.as_ref() == Some(frame)).collect()
    }

    /// Writes the annotations of these items beside the manifest. Items that cannot be drawn are
    /// reported to `warn` and skipped.
    pub(super) fn keep(
        &self,
        items: &[&Item],
        warn: &mut dyn FnMut(SkipReason),
    ) -> Result<KeptAnnotations, PlanError> {
        let shape_of = |geometry: &Geometry| self.shape(geometry)?.map_err(&mut *warn).ok().map(Arc::new);
        KeptAnnotations::keep(items.iter().copied(), shape_of, &self.folder)
            .map_err(|source| PlanError::Unwritable { path: self.folder.clone(), source })
    }

    fn shape(&self, geometry: &Geometry) -> Option<Result<SurfaceMesh, SkipReason>> {
        let content = self.runtime.block_on(self.log.content(geometry.content()?));
        let label = if let Geometry::Region(region) = geometry { region.label } else { 0 };
        Some(content.map_err(SkipReason::from).and_then(|(_, bytes)| Ok(shape_of_content(&bytes, label)?)))
    }
}

impl Drop for AnnotationLog {
    fn drop(&mut self) {
        self.runtime.block_on(self.log.close());
    }
}
