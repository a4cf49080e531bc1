//! From stored values to a label map: one layer as it is, several laid over each other.

use super::FormatError;
use super::bytes::Source;
use super::header::{Header, NamedSegment};
use super::values;
use relief_volume::{LabelMap, Segment};

/// A label map and the anomalies of its file.
#[derive(Debug)]
pub struct ReadLabels {
    /// The map on the file's own grid, in patient LPS.
    pub map: LabelMap,
    /// How each anomaly was handled, as sentences.
    pub warnings: Vec<String>,
}

/// The layers of a label map, in each of which no segments overlap, and the anomalies of the file.
#[derive(Debug)]
pub struct ReadLayers {
    /// A map for each layer, on the file's own grid, in patient LPS. Segments of two layers may
    /// have the same label.
    pub layers: Vec<LabelMap>,
    /// How each anomaly was handled, as sentences.
    pub warnings: Vec<String>,
}

/// Reads the voxels of every layer.
pub(super) fn read_layers(
    source: &mut Source,
    header: &Header,
    described: &[NamedSegment],
) -> Result<ReadLayers, FormatError> {
    let labels = values_of(source, header)?;
    let count = header.layers;
    let layer = |at: usize| {
        let own: Vec<u16> = labels.iter().skip(at).step_by(count).copied().collect();
        let described = described.iter().filter(|segment| count == 1 || segment.layer == at);
        map_of(header, &own, described)
    };
    let layers = (0..count).map(layer).collect::<Result<_, _>>()?;
    Ok(ReadLayers { layers, warnings: Vec::new() })
}

/// Reads the voxels. Of segments that overlap, the one of the later layer has the voxel.
pub(super) fn read(
    source: &mut Source,
    header: &Header,
    described: Vec<NamedSegment>,
) -> Result<ReadLabels, FormatError> {
    let labels = values_of(source, header)?;
    let mut warnings = Vec::new();
    let (labels, described) = flatten(labels, header.layers, described, &mut warnings);
    Ok(ReadLabels { map: map_of(header, &labels, &described)?, warnings })
}

/// The map of labels that are all of one layer.
fn map_of<'a>(
    header: &Header,
    labels: &[u16],
    described: impl IntoIterator<Item = &'a NamedSegment>,
) -> Result<LabelMap, FormatError> {
    let segment = |segment: &NamedSegment| Segment::new(segment.label, segment.name.as_deref(), segment.rgb);
    let segments = described.into_iter().map(segment).collect();
    let expected = header.grid.voxel_count() as u64;
    LabelMap::new(header.grid.clone(), labels, segments)
        .map_err(|_| FormatError::Cut { expected, found: labels.len() as u64 })
}

/// The labels of all layers, those of a voxel side by side.
fn values_of(source: &mut Source, header: &Header) -> Result<Vec<u16>, FormatError> {
    let count = header.grid.voxel_count();
    let scale = header.scale;
    let label = |value: f64| {
        let label = scale.slope * value + scale.intercept;
        let is_label = (0.0..=f64::from(u16::MAX)).contains(&label) && label.fract() == 0.0;
        if is_label { Ok(label as u16) } else { Err(value) }
    };
    values::read(source, header.voxel, count * header.layers, label).map_err(|error| match error {
        FormatError::Value { index, found, .. } => {
            FormatError::Value { index, found, allowed: "a label: a whole number from 0 to 65535" }
        }
        other => other,
    })
}

/// One label for each voxel. Labels of several layers may be the same for different segments: then
/// segments are numbered in the order in which the file has them.
fn flatten(
    values: Vec<u16>,
    layers: usize,
    mut described: Vec<NamedSegment>,
    warnings: &mut Vec<String>,
) -> (Vec<u16>, Vec<NamedSegment>) {
    if layers == 1 {
        return (values, described);
    }
    let mut sorted: Vec<u16> = described.iter().map(|segment| segment.label).collect();
    sorted.sort_unstable();
    let is_ambiguous = sorted.windows(2).any(|pair| pair[0] == pair[1]);
    let mut renumbered = std::collections::HashMap::new();
    if is_ambiguous {
        warnings.push(
            "labels are used twice in different layers: segments are numbered in their order".to_owned(),
        );
        for (number, segment) in (1..).zip(&mut described) {
            renumbered.insert((segment.layer, segment.label), number);
            segment.label = number;
        }
    }
    let mut overlaps = 0u64;
    let flat = values
        .chunks_exact(layers)
        .map(|voxel| {
            let mut there = voxel.iter().enumerate().filter(|(_, label)| **label > 0);
            overlaps += u64::from(there.clone().count() > 1);
            there.next_back().map_or(0, |(layer, &label)| *renumbered.get(&(layer, label)).unwrap_or(&label))
        })
        .collect();
    if overlaps > 0 {
        warnings.push(format!("segments overlap in {overlaps} voxels: the one of the later layer has them"));
    }
    (flat, described)
}
