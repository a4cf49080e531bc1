//! The cache of the processor's ray caster: ranges of bricks of volumes, segments of bricks of label
//! maps, tables and maps of empty space of appearances, and light in cells. Voxels are not copied.

use std::sync::Arc;

use super::super::appearance::{AppearanceKey, PreparedBricks, VisibleBricks, VolumeBricks};
use super::super::request::RenderRequest;
use super::super::store::MemoryUse;
use super::super::tables::Tables;
use super::super::uniform::paths_end_in_neighbours;
use super::super::volume_plan::VolumePlan;
use super::light_cells::LightCells;
use crate::illumination::{FillingKey, LightQuantity};
use relief_volume::{BrickLabels, ContentHash, DistanceMap, LabelMap, Volume};

/// Most volumes, and most appearances, in the cache.
const KEPT: usize = 64;
/// Most coarse forms of volumes, and most bytes of them: the phases of a series play in turn.
const KEPT_COARSE: usize = 32;
const KEPT_COARSE_BYTES: usize = 512 << 20;
/// Most label maps.
const KEPT_LABELS: usize = 4;
/// Most fillings of cells with light.
const KEPT_LIGHT: usize = 4;

/// The tables of a request, as rays look them up.
pub(super) struct Looks {
    pub(super) tables: Tables,
    /// The opacities of the first table.
    pub(super) opacities: Vec<f32>,
    /// With segments, all tables and looks.
    pub(super) entries: Vec<[f32; 4]>,
    /// Whether bricks can be skipped: a pre-integrated sample's path must not reach beyond the bricks
    /// next to its own.
    pub(super) paths_end_in_neighbours: bool,
}

/// The looks of an appearance, and the empty space of a volume under it.
pub(crate) struct PreparedAppearance {
    key: AppearanceKey,
    pub(super) looks: Looks,
    pub(super) map: DistanceMap,
    pub(super) bricks: VisibleBricks,
}

/// The segments that occur in the bricks of a label map.
struct Segmented {
    volume: ContentHash,
    map: ContentHash,
    bricks: Arc<BrickLabels>,
}

/// Cells filled with one kind of light.
struct Filling {
    key: FillingKey,
    cells: LightCells,
}

/// Parts of volumes and appearances, least recently used first.
#[derive(Default)]
pub(super) struct Cache {
    volumes: Vec<(ContentHash, VolumeBricks)>,
    /// The next volume, and an appearance of it.
    adopted: Option<(PreparedBricks, Option<PreparedAppearance>)>,
    labels: Vec<Segmented>,
    appearances: Vec<PreparedAppearance>,
    fillings: Vec<Filling>,
    /// Coarse forms of volumes, which moving pictures show.
    coarse: Vec<(ContentHash, Volume)>,
    /// Volumes that were prepared since the start.
    made: u64,
}

impl Looks {
    /// The looks of a request on a volume with bricks of this edge.
    pub(super) fn new(request: &RenderRequest, volume: &Volume, brick_edge: usize) -> Self {
        Self::of_tables(Tables::new(request), request, volume, brick_edge)
    }

    fn of_tables(tables: Tables, request: &RenderRequest, volume: &Volume, brick_edge: usize) -> Self {
        let opacities = tables.own.entries.iter().map(|entry| entry[3]).collect();
        let entries = if request.labels.is_some() { tables.buffer() } else { Vec::new() };
        let paths_end_in_neighbours = paths_end_in_neighbours(request, volume.grid(), brick_edge);
        Self { tables, opacities, entries, paths_end_in_neighbours }
    }

    fn bytes(&self) -> usize {
        let own = self.tables.own.entries.len() * (size_of::<[f32; 4]>() + size_of::<f32>());
        own + size_of_val(self.entries.as_slice())
    }
}

impl PreparedAppearance {
    /// The appearance of a request on a volume with these bricks. `segments` are those of the bricks of
    /// the request's label map, if it has one.
    pub(crate) fn new(
        volume: &Volume,
        bricks: &VolumeBricks,
        segments: Option<&BrickLabels>,
        request: &RenderRequest,
    ) -> Self {
        let tables = Tables::new(request);
        let map = bricks.distance_map(segments, request, &tables, f32::from);
        let bricks = VisibleBricks::new(&map, request);
        let looks = Looks::of_tables(tables, request, volume, map.edge);
        Self { key: AppearanceKey::new(volume.content_hash(), request), looks, map, bricks }
    }
}

impl Cache {
    /// Prepares a volume and the appearance of a request; says whether anything was made.
    pub(super) fn prepare(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        plan: &VolumePlan,
    ) -> (&PreparedAppearance, bool) {
        let hash = volume.content_hash();
        let is_new = !self.has_appearance(hash, request);
        if is_new {
            self.prepare_volume(volume, hash, plan);
            // An adopted volume brings one.
            if !self.has_appearance(hash, request) {
                let segments = request.labels.as_ref().map(|labels| self.segments(hash, &labels.map, plan));
                let (_, bricks) = self.volumes.last().expect("made or found");
                let appearance = PreparedAppearance::new(volume, bricks, segments.as_deref(), request);
                make_room(&mut self.appearances, KEPT);
                self.appearances.push(appearance);
            }
        }
        (self.appearances.last().expect("made or found"), is_new)
    }

    /// Whether there is an appearance; it becomes the last.
    fn has_appearance(&mut self, volume: ContentHash, request: &RenderRequest) -> bool {
        let at = self.appearances.iter().position(|known| known.key.fits(volume, request));
        at.is_some_and(|at| {
            self.appearances[at..].rotate_left(1);
            true
        })
    }

    /// Makes a volume the last.
    fn prepare_volume(&mut self, volume: &Volume, hash: ContentHash, plan: &VolumePlan) {
        if let Some(at) = self.volumes.iter().position(|(known, _)| *known == hash) {
            self.volumes[at..].rotate_left(1);
            return;
        }
        self.made += 1;
        let adopted = self.adopted.take();
        let adopted =
            adopted.and_then(|(bricks, appearance)| Some((bricks.bricks_of(hash, plan)?, appearance)));
        let (bricks, appearance) = adopted.unwrap_or_else(|| (VolumeBricks::new(volume, plan), None));
        make_room(&mut self.volumes, KEPT);
        self.volumes.push((hash, bricks));
        if let Some(appearance) = appearance {
            make_room(&mut self.appearances, KEPT);
            self.appearances.push(appearance);
        }
    }

    /// Keeps a volume that another thread has prepared until it is shown.
    pub(super) fn adopt(&mut self, bricks: PreparedBricks, appearance: Option<PreparedAppearance>) {
        self.adopted = Some((bricks, appearance));
    }

    /// The coarse form of a volume.
    pub(super) fn coarse(&mut self, volume: &Volume) -> Volume {
        let hash = volume.content_hash();
        match self.coarse.iter().position(|(known, _)| *known == hash) {
            Some(at) => self.coarse[at..].rotate_left(1),
            None => {
                self.coarse.push((hash, volume.coarse()));
                let bytes = |kept: &[(_, Volume)]| -> usize {
                    kept.iter().map(|(_, volume)| size_of_val(volume.voxels_hu())).sum()
                };
                while self.coarse.len() > KEPT_COARSE
                    || (self.coarse.len() > 1 && bytes(&self.coarse) > KEPT_COARSE_BYTES)
                {
                    self.coarse.remove(0);
                }
            }
        }
        self.coarse.last().expect("made or found").1.clone()
    }

    fn segments(&mut self, volume: ContentHash, map: &LabelMap, plan: &VolumePlan) -> Arc<BrickLabels> {
        let hash = map.content_hash();
        let at = self.labels.iter().position(|known| known.volume == volume && known.map == hash);
        if let Some(at) = at {
            self.labels[at..].rotate_left(1);
        } else {
            make_room(&mut self.labels, KEPT_LABELS);
            let bricks = Arc::new(BrickLabels::new(map, plan.brick_edge));
            self.labels.push(Segmented { volume, map: hash, bricks });
        }
        self.labels.last().expect("made or found").bricks.clone()
    }

    /// Cells that were filled for a request, if they are in the cache.
    pub(super) fn light(
        &mut self,
        volume: ContentHash,
        request: &RenderRequest,
        quantity: &LightQuantity,
    ) -> Option<LightCells> {
        let key = FillingKey::new(volume, request, quantity.clone());
        let at = self.fillings.iter().position(|known| known.key == key)?;
        self.fillings[at..].rotate_left(1);
        self.fillings.last().map(|filling| filling.cells.clone())
    }

    /// Puts filled cells into the cache.
    pub(super) fn put_light(
        &mut self,
        volume: ContentHash,
        request: &RenderRequest,
        quantity: LightQuantity,
        cells: LightCells,
    ) {
        make_room(&mut self.fillings, KEPT_LIGHT);
        self.fillings.push(Filling { key: FillingKey::new(volume, request, quantity), cells });
    }

    /// The size of the cache, without a limit of bytes.
    pub(super) fn memory(&self) -> MemoryUse {
        let volumes: u64 = self.volumes.iter().map(|(_, bricks)| bricks.bytes()).sum();
        let looks = |known: &PreparedAppearance| (known.looks.bytes() + known.map.distances.len()) as u64;
        let appearances: u64 = self.appearances.iter().map(looks).sum();
        let light: u64 = self.fillings.iter().map(|filling| filling.cells.bytes()).sum();
        let coarse = |volume: &Volume| size_of_val(volume.voxels_hu()) as u64;
        let coarse: u64 = self.coarse.iter().map(|(_, volume)| coarse(volume)).sum();
        let used_bytes = volumes + appearances + light + coarse;
        MemoryUse { volumes: self.volumes.len(), used_bytes, uploads: self.made, ..MemoryUse::default() }
    }

    /// Drops a volume and all that depends on it.
    pub(super) fn forget(&mut self, volume: ContentHash) {
        self.volumes.retain(|(known, _)| *known != volume);
        self.labels.retain(|known| known.volume != volume);
        self.appearances.retain(|known| known.key.volume != volume);
        self.fillings.retain(|known| known.key.volume != volume);
        let coarse: Vec<_> = self.coarse.extract_if(.., |(known, _)| *known == volume).collect();
        coarse.into_iter().for_each(|(_, coarse)| self.forget(coarse.content_hash()));
    }

    /// Drops everything.
    pub(super) fn clear(&mut self) {
        *self = Self { made: self.made, ..Self::default() };
    }
}

fn make_room<T>(kept: &mut Vec<T>, most: usize) {
    if kept.len() == most {
        kept.remove(0);
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::preparation::Preparation;
    use super::super::super::scene::SceneFile;
    use super::super::super::volume_plan::VolumeLimits;
    use super::*;
    use relief_volume::{Orbit, Phantom};

    /// Invariant: A volume that another thread has prepared brings the map of empty space that the
    /// renderer would make.
    #[test]
    fn an_adopted_volume_brings_its_appearance() {
        let volume = Phantom::head(32).unwrap().volume;
        let limits = VolumeLimits::of_processor();
        let plan = limits.plan(volume.grid().dims()).unwrap();
        let request = |preset: &str| {
            let scene = SceneFile::default().with_preset(preset).with_size([64, 64]);
            scene.resolve(volume.grid(), &Orbit::default()).unwrap().request
        };
        for (shown, appearances) in [("bone", 1), ("skin", 2)] {
            let prepared = Preparation { limits, on_processor: true }.of(&volume, &request("bone")).unwrap();
            let (mut adopting, mut own) = (Cache::default(), Cache::default());
            adopting.adopt(prepared.bricks, prepared.appearance);
            let (adopted, is_new) = adopting.prepare(&volume, &request(shown), &plan);
            let (made, _) = own.prepare(&volume, &request(shown), &plan);
            assert!(is_new && adopted.map == made.map && adopted.looks.opacities == made.looks.opacities);
            assert_eq!(adopting.appearances.len(), appearances, "{shown}");
        }
        let on_card = Preparation { limits, on_processor: false };
        assert!(on_card.of(&volume, &request("bone")).unwrap().appearance.is_none());
    }
}
