//! The transfer tables of a request: one, or with labels several and the looks that choose among
//! them.
//!
//! With labels, one buffer holds the request's own table, two entries for each look, and the tables
//! of further transfer functions, in this order; `shaders/lib/labels.wgsl` reads it. Values in HU.

use super::classification::Classification;
use super::interest::is_of_interest;
use super::labels::{Labels, Look};
use super::mode::Mode;
use super::request::RenderRequest;
use relief_volume::{TransferFunction, TransferTable};

/// The tables that samples look up.
pub(super) struct Tables {
    /// The table of the request's own transfer function.
    pub(super) own: TransferTable,
    /// Tables of the further transfer functions of its labels.
    others: Vec<TransferTable>,
    /// None without labels.
    looks: Vec<Look>,
}

/// The tables that may be looked up in a brick, a bit each.
pub(super) type TableSet = u32;

const _: () = assert!(Labels::MOST_TRANSFERS < TableSet::BITS as usize, "a bit for each table");

impl Tables {
    /// The tables of a request. A projection's opacity is per opacity unit, whatever the sample
    /// distance.
    pub(super) fn new(request: &RenderRequest) -> Self {
        let step_mm = |transfer: &TransferFunction| match request.mode {
            Mode::Composite | Mode::PathTraced => request.sample_distance_mm,
            Mode::Mip
            | Mode::Minip
            | Mode::Mean
            | Mode::Average
            | Mode::Additive
            | Mode::Isosurface
            | Mode::Slice(_) => transfer.opacity_unit_mm(),
        };
        let Some(labels) = &request.labels else {
            let own_mm = step_mm(&request.transfer);
            let own = match request.classification {
                Classification::Sampled => TransferTable::new(&request.transfer, own_mm),
                Classification::PreIntegrated => TransferTable::integrated(&request.transfer, own_mm),
            };
            return Self { own, others: Vec::new(), looks: Vec::new() };
        };
        let room = TransferTable::MAX_ENTRIES - 2 * labels.looks.len();
        let most = room / (1 + labels.transfers.len());
        let table = |transfer: &TransferFunction| TransferTable::within(transfer, step_mm(transfer), most);
        let others = labels.transfers.iter().map(table).collect();
        Self { own: table(&request.transfer), others, looks: labels.looks.clone() }
    }

    /// The table of a look.
    pub(super) fn of(&self, look: &Look) -> &TransferTable {
        look.transfer.checked_sub(1).map_or(&self.own, |at| &self.others[at])
    }

    /// The content of the shader's buffer.
    pub(super) fn buffer(&self) -> Vec<[f32; 4]> {
        let mut buffer = self.own.buffer();
        if self.looks.is_empty() {
            return buffer;
        }
        let mut starts = vec![0];
        let mut start = buffer.len() + 2 * self.looks.len();
        for table in &self.others {
            starts.push(start);
            start += table.entries.len();
        }
        for look in &self.looks {
            let table = self.of(look);
            let last = if look.visible { table.entries.len() - 1 } else { 0 };
            // Exact: entries are counted to 4096, and the step is a power of two.
            let numbers = [starts[look.transfer] as f32, last as f32];
            buffer.push([table.first_hu, 1.0 / table.step_hu, numbers[0], numbers[1]]);
            let [r, g, b] = look.tint_rgb.map(|channel| (look.tint * channel) as f32);
            buffer.push([r, g, b, (1.0 - look.tint) as f32]);
        }
        buffer.extend(self.others.iter().flat_map(|table| &table.entries));
        buffer
    }

    /// No value below this is visible, HU, whatever its segment.
    pub(super) fn lowest_visible_hu(&self) -> f32 {
        if self.looks.is_empty() {
            return self.own.lowest_visible_hu();
        }
        self.shown().map(TransferTable::lowest_visible_hu).fold(f32::MAX, f32::min)
    }

    /// The tables of looks that are shown, some of them several times.
    fn shown(&self) -> impl Iterator<Item = &TransferTable> {
        self.looks.iter().filter(|look| look.visible).map(|look| self.of(look))
    }

    /// The tables that the shown ones among these segments look up; places as in
    /// [`relief_volume::SegmentIndices`].
    pub(super) fn set_of(&self, places: &[u16]) -> TableSet {
        let looks = places.iter().map(|&place| &self.looks[usize::from(place)]);
        looks.filter(|look| look.visible).fold(0, |set, look| set | 1 << look.transfer)
    }

    /// Whether a brick with values in this range can change the picture.
    pub(super) fn is_of_interest(&self, request: &RenderRequest, low_hu: f32, high_hu: f32) -> bool {
        is_of_interest(request, &self.own, low_hu, high_hu)
    }

    /// The same for a brick whose visible segments use these tables. A value that is invisible in a
    /// segment may still be the largest of a ray, so a projection considers all tables.
    pub(super) fn is_of_interest_in(
        &self,
        request: &RenderRequest,
        set: TableSet,
        low_hu: f32,
        high_hu: f32,
    ) -> bool {
        let of_table = |table: &TransferTable| is_of_interest(request, table, low_hu, high_hu);
        match request.mode {
            Mode::Mip | Mode::Minip => set != 0 && self.shown().any(of_table),
            _ => {
                let tables = std::iter::once(&self.own).chain(&self.others).enumerate();
                tables.filter(|(at, _)| set >> at & 1 == 1).any(|(_, table)| of_table(table))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use super::super::labels::Edges;
    use super::super::scene::SceneFile;
    use super::*;
    use relief_volume::{Grid, LabelMap, Orbit, PRESETS, Segment, preset};

    fn labelled(segments: u16, transfers: usize) -> RenderRequest {
        let grid = Grid::axis_aligned([4; 3], [1.0; 3], [0.0; 3]).unwrap();
        let described = (1..=segments).map(|label| Segment::new(label, None, None)).collect();
        let map = LabelMap::new(grid.clone(), &[0; 64], described).unwrap();
        let scene = SceneFile::default().resolve(&grid, &Orbit::default()).unwrap();
        let look = |at: usize| Look {
            visible: at % 3 != 2,
            transfer: at % (transfers + 1),
            tint_rgb: [0.5, 1.0, 0.25],
            tint: 0.25,
        };
        let labels = Labels {
            map: Arc::new(map),
            looks: (0..=usize::from(segments)).map(look).collect(),
            transfers: PRESETS[..transfers].iter().map(relief_volume::Preset::transfer).collect(),
            edges: Edges::Smooth,
        };
        RenderRequest { labels: Some(Arc::new(labels)), ..scene.request }
    }

    #[test]
    fn the_largest_request_fits_into_the_buffer_and_every_look_finds_its_table() {
        for (segments, transfers) in [(512, 15), (512, 0), (1, 1), (117, 4)] {
            let request = labelled(segments, transfers);
            request.validate().unwrap();
            let tables = Tables::new(&request);
            let buffer = tables.buffer();
            assert!(buffer.len() <= TransferTable::MAX_ENTRIES, "{} entries", buffer.len());
            for (at, look) in tables.looks.iter().enumerate() {
                let place = tables.own.entries.len() + 2 * at;
                let [first_hu, per_hu, first, last] = buffer[place];
                let table = tables.of(look);
                assert_eq!((first_hu, 1.0 / per_hu), (table.first_hu, table.step_hu));
                assert_eq!(last > 0.0, look.visible, "look {at}");
                let entries = &buffer[first as usize..][..table.entries.len()];
                assert_eq!(entries, table.entries);
                assert_eq!(buffer[place + 1], [0.125, 0.25, 0.0625, 0.75]);
            }
        }
    }

    #[test]
    fn a_brick_is_of_interest_by_the_tables_of_its_shown_segments_alone() {
        let mut request = labelled(2, 1);
        let mut labels = (*request.labels.clone().unwrap()).clone();
        let look = |visible, transfer| Look { visible, transfer, ..Look::PLAIN };
        labels.looks = vec![look(false, 0), look(true, 1), look(true, 0)];
        labels.transfers = vec![preset("skin").unwrap().transfer()];
        request.labels = Some(Arc::new(labels));
        let tables = Tables::new(&request);
        // The request's own preset is bone: 40 HU are visible only as skin.
        let of = |request: &RenderRequest, places: &[u16]| {
            tables.is_of_interest_in(request, tables.set_of(places), 0.0, 40.0)
        };
        assert_eq!(
            [&[0][..], &[1], &[2], &[0, 2], &[0, 1, 2]].map(|set| of(&request, set)),
            [false, true, false, false, true]
        );
        request.mode = Mode::Mip;
        assert_eq!([&[0][..], &[1], &[2]].map(|set| of(&request, set)), [false, true, true]);
        assert!(tables.lowest_visible_hu() < 40.0, "skin's counts, bone's is beyond 100 HU");
    }
}
