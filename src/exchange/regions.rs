//! Label maps: each segment is a region, whose voxels are a content of the whole map.
//!
//! A content is always a `.seg.nrrd` file of this crate's own, whatever the file was that it came in; several regions of a file
//! share one. A written map has the segments of all regions, numbered from 1 in their order; where regions overlap, the later
//! one has the voxel. Maps of other grids are resampled by the nearest voxel.

use std::collections::BTreeMap;
use std::io::Write;

use super::reading::Reading;
use super::structures::REGION_TYPE;
use super::{ExchangeError, Format, Imported, LeftOut, ReadContext, WriteContext};
use crate::annotation::{ContentId, Geometry, Item, ItemId, RegionSummary};
use crate::formats;
use crate::volume::{Grid, LabelMap, Segment};

/// Reads a map of NRRD or NIfTI.
///
/// # Errors
/// As [`super::read`].
pub(super) fn read(
    format: Format,
    bytes: &[u8],
    context: &ReadContext<'_>,
) -> Result<Imported, ExchangeError> {
    let found = labels(format, bytes)?;
    of_map(format, &found.map, found.warnings, context)
}

/// The items of a map.
pub(super) fn of_map(
    format: Format,
    map: &LabelMap,
    warnings: Vec<String>,
    context: &ReadContext<'_>,
) -> Result<Imported, ExchangeError> {
    let mut reading = Reading::new(format, context);
    for warning in warnings {
        reading.warn("", &warning);
    }
    let bytes = formats::seg_nrrd(map).map_err(|error| failed(format, &error))?;
    let content = ContentId::of(&bytes);
    for (segment, voxels) in map.counted() {
        let label = segment.label;
        if voxels == 0 {
            reading.warn(&format!("segment {label}"), "a segment without voxels is left out");
            continue;
        }
        let volume_ml = voxels as f64 * map.voxel_mm3() / 1000.0;
        let summary = RegionSummary { content: content.clone(), label, voxels, volume_ml };
        let name: String = segment.name.as_deref().unwrap_or("").chars().take(Item::LONGEST_NAME).collect();
        let name = if name.is_empty() { format!("{}-{label}", context.list) } else { name };
        let mut item = reading.item(&name, Some(Geometry::Region(summary)))?;
        item.rgb = segment.rgb;
        reading.push(&format!("segment {label}"), item)?;
    }
    if reading.count() == 0 {
        return Err(ExchangeError::value(format, "the map", "without labelled voxels", "at least one"));
    }
    if context.grid.is_some_and(|grid| !touches(map.grid(), grid)) {
        reading.warn("", "the map lies outside of the volume; is it of the same scan?");
    }
    reading.contents.push((content, REGION_TYPE.to_owned(), bytes));
    Ok(reading.finish())
}

/// Whether the boxes around two grids have a place in common.
fn touches(a: &Grid, b: &Grid) -> bool {
    let (a, b) = (a.bounds(), b.bounds());
    let low = a.min.xyz.max(b.min.xyz);
    low.cmplt(a.max.xyz.min(b.max.xyz)).all()
}

pub(super) fn failed(format: Format, error: &dyn std::fmt::Display) -> ExchangeError {
    ExchangeError::Syntax { format, place: "the map".to_owned(), message: error.to_string() }
}

/// A map of a file's bytes; readers of maps take files.
fn labels(format: Format, bytes: &[u8]) -> Result<formats::ReadLabels, ExchangeError> {
    let mut file = tempfile::NamedTempFile::new().map_err(|error| failed(format, &error))?;
    file.write_all(bytes).and_then(|()| file.flush()).map_err(|error| failed(format, &error))?;
    formats::read_labels(file.path()).map_err(|error| failed(format, &error))
}

/// The map of all regions, on the grid wanted or else that of the first of them; the items of its labels from 1; and what was
/// lost on the way.
///
/// # Errors
/// When a content is not there or no label map.
pub(super) fn join(
    format: Format,
    items: &[&Item],
    context: &WriteContext<'_>,
) -> Result<(LabelMap, Vec<ItemId>, Vec<LeftOut>), ExchangeError> {
    let mut joined: Option<Joined> = None;
    let mut maps = BTreeMap::new();
    for item in items {
        let Some(Geometry::Region(region)) = &item.geometry else { continue };
        if !maps.contains_key(&region.content) {
            let bytes = (context.contents)(&region.content).ok_or_else(|| no_content(format, item.id))?;
            let map = labels(Format::SegNrrd, &bytes)?.map;
            let grid = joined.as_ref().map(|joined| &joined.grid).or(context.grid).unwrap_or(map.grid());
            let map = if map.grid() == grid { map } else { map.resampled(grid) };
            maps.insert(region.content.clone(), map);
        }
        let map = &maps[&region.content];
        joined.get_or_insert_with(|| Joined::new(map.grid())).add(item, map, region.label);
    }
    let Some(Joined { grid, labels, segments, items, lost }) = joined else {
        return Err(ExchangeError::Nothing { format, why: "there are no regions".to_owned() });
    };
    let map = LabelMap::new(grid, &labels, segments).map_err(|error| failed(format, &error))?;
    Ok((map, items, lost))
}

pub(super) fn no_content(format: Format, id: ItemId) -> ExchangeError {
    ExchangeError::value(format, format!("the content of item {id}"), "not there", "the voxels of the region")
}

/// Regions laid over each other.
struct Joined {
    grid: Grid,
    labels: Vec<u16>,
    segments: Vec<Segment>,
    items: Vec<ItemId>,
    lost: Vec<LeftOut>,
}

impl Joined {
    fn new(grid: &Grid) -> Self {
        let labels = vec![0; grid.voxel_count()];
        Self { grid: grid.clone(), labels, segments: Vec::new(), items: Vec::new(), lost: Vec::new() }
    }

    fn add(&mut self, item: &Item, map: &LabelMap, label: u16) {
        let number = u16::try_from(self.segments.len() + 1).unwrap_or(u16::MAX);
        // Places count segments from 1.
        let place = map.segments().iter().position(|segment| segment.label == label).map_or(0, |at| at + 1);
        let (mut voxels, mut covered) = (0u64, BTreeMap::new());
        for (at, to) in self.labels.iter_mut().enumerate() {
            if place > 0 && map.places().at(at) == place {
                voxels += 1;
                if *to > 0 {
                    *covered.entry(*to).or_insert(0u64) += 1;
                }
                *to = number;
            }
        }
        if voxels == 0 {
            let reason = "none of it lies on the voxels of the map that is written".to_owned();
            self.lost.push(LeftOut { what: "regions".to_owned(), reason, items: vec![item.id] });
            return;
        }
        for (below, count) in covered {
            let what = format!("{count} voxels that another region has too");
            let items = vec![self.items[usize::from(below) - 1]];
            self.lost.push(LeftOut { what, reason: format!("{:?} has them", item.name), items });
        }
        self.segments.push(Segment::new(number, Some(&item.name), item.rgb));
        self.items.push(item.id);
    }
}
