//! Label maps: each segment is a region, whose voxels are a content of the whole map.
//!
//! A content is always a `.seg.nrrd` file of this crate's own with one layer, whatever the file was
//! that it came in; regions of a file share one, or one for each layer where they overlap. A
//! written map has the segments of all regions, numbered from 1 in their order. Where regions
//! overlap, they are in layers (seg.nrrd) or have frames of their own (seg). NIfTI and DICOM label
//! maps have one label for a voxel: there the later region has it. Maps of other grids are
//! resampled by the nearest voxel.

use std::collections::BTreeMap;

use super::reading::Reading;
use super::structures::REGION_TYPE;
use super::{ExchangeError, Format, Imported, LeftOut, NothingLeft, ReadContext, SyntaxError, WriteContext};
use relief_annotation::{ContentId, Geometry, Item, ItemId, RegionSummary};
use relief_dicom::FormatLimits;

use relief_volume::{Grid, LabelMap, Layers, LayersError, Segment};

/// Bytes that the layers of a map may take, two for each voxel.
const MOST_BYTES: u64 = 4 << 30;

/// Reads a map of NRRD or NIfTI.
///
/// # Errors
/// As [`super::read`].
pub(super) fn read(
    format: Format,
    bytes: &[u8],
    context: &ReadContext<'_>,
) -> Result<Imported, ExchangeError> {
    let limits = FormatLimits { voxels: context.most_voxels() };
    let found =
        relief_dicom::read_label_layers_of_bytes(limits, bytes).map_err(|error| failed(format, error))?;
    of_layers(format, &found.layers, found.warnings, context)
}

/// The items of a map's layers, in the order of their labels.
pub(super) fn of_layers(
    format: Format,
    layers: &[LabelMap],
    warnings: Vec<String>,
    context: &ReadContext<'_>,
) -> Result<Imported, ExchangeError> {
    let mut reading = Reading::new(format, context);
    for warning in warnings {
        reading.warn("", &warning);
    }
    let mut found = Vec::new();
    for map in layers {
        let bytes = relief_dicom::write_seg_nrrd(map).map_err(|error| failed(format, error))?;
        let content = ContentId::of(&bytes);
        found.extend(map.counted().map(|(segment, voxels)| (segment, voxels, content.clone(), map)));
        if map.labelled_voxels() > 0 {
            reading.contents.push((content, REGION_TYPE.to_owned(), bytes));
        }
    }
    found.sort_by_key(|(segment, ..)| segment.label);
    for (number, (segment, voxels, content, map)) in (1..).zip(found) {
        let label = segment.label;
        if voxels == 0 {
            reading.warn(&format!("segment {label}"), "a segment without voxels is left out");
            continue;
        }
        let volume_ml = voxels as f64 * map.voxel_mm3() / 1000.0;
        let summary = RegionSummary { content, label, voxels, volume_ml };
        let name: String = segment.name.as_deref().unwrap_or("").chars().take(Item::LONGEST_NAME).collect();
        // Labels of different layers may be the same.
        let own = if layers.len() == 1 { usize::from(label) } else { number };
        let name = if name.is_empty() { format!("{}-{own}", context.list) } else { name };
        let mut item = reading.item(&name, Some(Geometry::Region(summary)))?;
        item.rgb = segment.rgb;
        reading.push(&format!("segment {label}"), item)?;
    }
    if reading.count() == 0 {
        return Err(ExchangeError::value(format, "the map", "without labelled voxels", "at least one"));
    }
    let lies_outside = |grid| layers.iter().all(|map| !touches(map.grid(), grid));
    if context.grid.is_some_and(lies_outside) {
        reading.warn("", "the map lies outside of the volume; is it of the same scan?");
    }
    Ok(reading.finish())
}

/// Whether the boxes around two grids have a place in common.
fn touches(a: &Grid, b: &Grid) -> bool {
    let (a, b) = (a.bounds(), b.bounds());
    let low = a.min.xyz.max(b.min.xyz);
    low.cmplt(a.max.xyz.min(b.max.xyz)).all()
}

pub(super) fn failed(format: Format, error: impl std::error::Error + Send + Sync + 'static) -> ExchangeError {
    let source = SyntaxError::Content(error.into());
    ExchangeError::Syntax { format, place: "the map".to_owned(), source }
}

/// The parts of a file.
pub(super) struct LabelMapParts {
    /// Layers; one at least.
    pub(super) maps: Vec<LabelMap>,
    /// The items of the labels, from 1.
    pub(super) items: Vec<ItemId>,
    /// The losses of the conversion.
    pub(super) lost: Vec<LeftOut>,
}

/// The layers of all regions, on the given grid or else that of the first region; the items of its
/// labels from 1; and the losses. NIfTI and DICOM label maps have one layer.
///
/// # Errors
/// When a content is not there or no label map, or regions overlap in too many layers.
pub(super) fn join(
    format: Format,
    items: &[&Item],
    context: &WriteContext<'_>,
) -> Result<LabelMapParts, ExchangeError> {
    let mut joined: Option<JoinedRegions> = None;
    let mut maps = BTreeMap::new();
    for item in items {
        let Some(Geometry::Region(region)) = &item.geometry else { continue };
        if !maps.contains_key(&region.content) {
            let bytes = (context.contents)(&region.content).ok_or_else(|| no_content(format, item.id))?;
            let map = relief_dicom::read_labels_of_bytes(&bytes);
            let map = map.map_err(|error| failed(Format::SegNrrd, error))?.map;
            let grid = joined.as_ref().map(|joined| &joined.grid).or(context.grid).unwrap_or(map.grid());
            let map = if map.grid() == grid { map } else { map.resampled(grid) };
            maps.insert(region.content.clone(), map);
        }
        let map = &maps[&region.content];
        let joined = joined.get_or_insert_with(|| {
            JoinedRegions::new(map.grid(), matches!(format, Format::Nifti | Format::LabelMap))
        });
        joined.add(item, map, region.label).map_err(|error| failed(format, error))?;
    }
    let Some(JoinedRegions { grid, voxels, segments, items, lost }) = joined else {
        return Err(ExchangeError::Nothing { format, reason: NothingLeft::NoRegions });
    };
    let maps = match voxels {
        Voxels::Layers(layers) => layers.into_maps(),
        Voxels::Flat(labels) => {
            vec![LabelMap::new(grid, &labels, segments).map_err(|error| failed(format, error))?]
        }
    };
    if maps.is_empty() {
        return Err(ExchangeError::Nothing { format, reason: NothingLeft::NoVoxels });
    }
    Ok(LabelMapParts { maps, items, lost })
}

pub(super) fn no_content(format: Format, id: ItemId) -> ExchangeError {
    ExchangeError::value(format, format!("the content of item {id}"), "not there", "the voxels of the region")
}

/// Regions of one grid.
struct JoinedRegions {
    grid: Grid,
    voxels: Voxels,
    segments: Vec<Segment>,
    items: Vec<ItemId>,
    lost: Vec<LeftOut>,
}

/// Whose voxels are whose.
enum Voxels {
    /// A label each: what overlaps is lost.
    Flat(Vec<u16>),
    Layers(Layers),
}

impl JoinedRegions {
    fn new(grid: &Grid, is_flat: bool) -> Self {
        let voxels = if is_flat {
            Voxels::Flat(vec![0; grid.voxel_count()])
        } else {
            Voxels::Layers(Layers::new(grid.clone(), MOST_BYTES))
        };
        Self { grid: grid.clone(), voxels, segments: Vec::new(), items: Vec::new(), lost: Vec::new() }
    }

    fn add(&mut self, item: &Item, map: &LabelMap, label: u16) -> Result<(), LayersError> {
        let number = u16::try_from(self.segments.len() + 1).unwrap_or(u16::MAX);
        let segment = Segment::new(number, Some(&item.name), item.rgb);
        // Places count segments from 1.
        let place = map.segments().iter().position(|segment| segment.label == label).map_or(0, |at| at + 1);
        let own = (0..self.grid.voxel_count()).filter(|&at| place > 0 && map.places().at(at) == place);
        if own.clone().next().is_none() {
            let reason = "none of it lies on the voxels of the map that is written".to_owned();
            self.lost.push(LeftOut { what: "regions".to_owned(), reason, items: vec![item.id] });
            return Ok(());
        }
        match &mut self.voxels {
            Voxels::Layers(layers) => {
                layers.add(segment.clone(), own)?;
            }
            Voxels::Flat(labels) => {
                let mut covered = BTreeMap::new();
                for at in own {
                    if labels[at] > 0 {
                        *covered.entry(labels[at]).or_insert(0u64) += 1;
                    }
                    labels[at] = number;
                }
                for (below, count) in covered {
                    let what = format!("{count} voxels that another region has too");
                    let reason = format!("{:?} has them; seg.nrrd and seg hold both", item.name);
                    let items = vec![self.items[usize::from(below) - 1]];
                    self.lost.push(LeftOut { what, reason, items });
                }
            }
        }
        self.segments.push(segment);
        self.items.push(item.id);
        Ok(())
    }
}
