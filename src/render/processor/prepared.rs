//! The cache of the processor's ray caster: ranges of bricks of volumes, tables and maps of empty
//! space of appearances. Voxels are not copied.

use super::super::appearance::{AppearanceKey, VisibleBricks, VolumeBricks};
use super::super::request::RenderRequest;
use super::super::store::MemoryUse;
use super::super::tables::Tables;
use super::super::volume_plan::VolumePlan;
use relief_volume::{ContentHash, DistanceMap, Volume};

/// Most volumes, and most appearances, in the cache.
const KEPT: usize = 16;

/// The tables of an appearance, and the empty space of a volume under it.
pub(super) struct Prepared {
    key: AppearanceKey,
    pub(super) tables: Tables,
    /// The opacities of the first table.
    pub(super) opacities: Vec<f32>,
    pub(super) map: DistanceMap,
    pub(super) bricks: VisibleBricks,
}

/// Bricks of volumes and appearances, least recently used first.
#[derive(Default)]
pub(super) struct Cache {
    volumes: Vec<(ContentHash, VolumeBricks)>,
    appearances: Vec<Prepared>,
    /// Volumes that were prepared since the start.
    made: u64,
}

impl Prepared {
    fn bytes(&self) -> u64 {
        let table = self.tables.own.entries.len() * (size_of::<[f32; 4]>() + size_of::<f32>());
        (table + self.map.distances.len()) as u64
    }
}

impl Cache {
    /// Prepares a volume and the appearance of a request; says whether anything was made.
    pub(super) fn prepare(
        &mut self,
        volume: &Volume,
        request: &RenderRequest,
        plan: &VolumePlan,
    ) -> (&Prepared, bool) {
        let hash = volume.content_hash();
        if let Some(at) = self.appearances.iter().position(|known| known.key.fits(hash, request)) {
            self.appearances[at..].rotate_left(1);
            return (self.appearances.last().expect("one was found"), false);
        }
        let at = self.volumes.iter().position(|(known, _)| *known == hash);
        match at {
            Some(at) => self.volumes[at..].rotate_left(1),
            None => {
                make_room(&mut self.volumes);
                self.made += 1;
                self.volumes.push((hash, VolumeBricks::new(volume, plan)));
            }
        }
        let (_, bricks) = self.volumes.last().expect("made or found");
        let tables = Tables::new(request);
        let mut map = bricks.distance_map(None, request, &tables, f32::from);
        let opacities = tables.own.entries.iter().map(|entry| entry[3]).collect();
        let bricks = VisibleBricks::new(&map, request);
        // Rays read four bytes at a time.
        map.distances.extend([0; 3]);
        make_room(&mut self.appearances);
        let key = AppearanceKey::new(hash, request);
        self.appearances.push(Prepared { key, tables, opacities, map, bricks });
        (self.appearances.last().expect("just made"), true)
    }

    /// The size of the cache, without a limit of bytes.
    pub(super) fn memory(&self) -> MemoryUse {
        let ranges = |bricks: &VolumeBricks| bricks.bytes();
        let volumes: u64 = self.volumes.iter().map(|(_, bricks)| ranges(bricks)).sum();
        let appearances: u64 = self.appearances.iter().map(Prepared::bytes).sum();
        let used_bytes = volumes + appearances;
        MemoryUse { volumes: self.volumes.len(), used_bytes, uploads: self.made, ..MemoryUse::default() }
    }

    /// Drops a volume and its appearances.
    pub(super) fn forget(&mut self, volume: ContentHash) {
        self.volumes.retain(|(known, _)| *known != volume);
        self.appearances.retain(|known| known.key.volume != volume);
    }

    /// Drops everything.
    pub(super) fn clear(&mut self) {
        (self.volumes, self.appearances) = (Vec::new(), Vec::new());
    }
}

fn make_room<T>(kept: &mut Vec<T>) {
    if kept.len() == KEPT {
        kept.remove(0);
    }
}
