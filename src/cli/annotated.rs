//! Annotations of a log, drawn over a picture.

use std::collections::HashMap;
use std::sync::Arc;

use anyhow::{Context, bail};

use relief_annotation::{ContentId, FrameOfReference, Geometry, Item};
use relief_dicom::Loaded;
use relief_render::Scene;
use relief_session::{Drawables, SurfaceMesh, shape_of_content};
use relief_store::{Filter, Listing, Store, StoreError};

/// Adds the annotations that a scene requests to its overlays. Blinded sets must be named.
pub(super) fn draw_annotations(
    place: Option<&str>,
    loaded: &Loaded,
    scene: &mut Scene,
) -> anyhow::Result<()> {
    if scene.annotations.is_nothing() {
        return Ok(());
    }
    let Some(place) = place else {
        bail!("the scene draws annotations; say which log has them with --annotations PLACE");
    };
    let id = loaded.volume.content_hash().short();
    let frame = FrameOfReference::of(loaded.identity.frame_of_reference(), &id);
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
    let phase = loaded.identity.phase().map(|phase| phase.number);
    let (listing, contents) =
        runtime.block_on(read(place, frame, phase, scene)).context("--annotations cannot be read")?;
    let items: Vec<&Item> = listing.items.iter().map(|known| &known.item).collect();
    let shape_of = |geometry: &Geometry| {
        let bytes = contents.get(geometry.content()?)?;
        let label = if let Geometry::Region(region) = geometry { region.label } else { 0 };
        shape_of_content(bytes, label)
            .map_err(|reason| tracing::warn!("an annotation cannot be drawn: {reason}"))
            .ok()
            .map(Arc::<SurfaceMesh>::new)
    };
    let drawables = Drawables::new(items, shape_of);
    let drawn = drawables.draw(&mut scene.request, &scene.display, loaded.volume.grid());
    if drawn.left_out > 0 {
        eprintln!("warning: {} annotations are left out; a picture has no room for more", drawn.left_out);
    }
    Ok(())
}

type Contents = HashMap<ContentId, Vec<u8>>;

async fn read(
    place: &str,
    frame: FrameOfReference,
    phase: Option<usize>,
    scene: &Scene,
) -> Result<(Listing, Contents), StoreError> {
    let log = Store::open_existing(place).await?;
    let sets = log.sets().await?;
    let is_open = |name: &str| !sets.iter().any(|set| set.blinded && set.name == name);
    let is_named = matches!(scene.annotations, relief_annotation::ShownSets::Sets(_));
    let filter = Filter { frame_of_reference: Some(frame), ..Filter::default() };
    let mut listing = log.list(&filter).await?;
    listing.items.retain(|known| {
        let item = &known.item;
        scene.annotations.has(&item.set) && (is_named || is_open(&item.set)) && item.is_in_phase(phase)
    });
    let mut contents = Contents::new();
    let visible = listing.items.iter().filter(|known| known.item.visible);
    for id in visible.filter_map(|known| known.item.geometry.as_ref()?.content()) {
        if !contents.contains_key(id) {
            contents.insert(id.clone(), log.content(id).await?.1);
        }
    }
    log.close().await;
    Ok((listing, contents))
}
