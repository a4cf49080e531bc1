//! From stored values to a label map: one layer as it is, several laid over each other.

use super::FormatError;
use super::bytes::Source;
use super::header::{Header, NamedSegment};
use super::values;
use crate::volume::{LabelMap, Segment};

/// A label map and what was unusual about its file.
#[derive(Debug)]
pub struct ReadLabels {
    /// The map on the file's own grid, in patient LPS.
    pub map: LabelMap,
    /// What was done about what was unusual, in sentences.
    pub warnings: Vec<String>,
}

/// Reads the voxels. Of segments that overlap, the one of the later layer has the voxel.
pub(super) fn read(
    source: &mut Source,
    header: &Header,
    described: Vec<NamedSegment>,
) -> Result<ReadLabels, FormatError> {
    let count = header.grid.voxel_count();
    let scale = header.scale;
    let label = |value: f64| {
        let label = scale.slope * value + scale.intercept;
        let is_label = (0.0..=f64::from(u16::MAX)).contains(&label) && label.fract() == 0.0;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked above")]
        if is_label { Ok(label as u16) } else { Err(value) }
    };
    let labels =
        values::read(source, header.voxel, count * header.layers, label).map_err(|error| match error {
            FormatError::Value { index, found, .. } => {
                FormatError::Value { index, found, allowed: "a label: a whole number from 0 to 65535" }
            }
            other => other,
        })?;
    let mut warnings = header.warnings.clone();
    let (labels, described) = flatten(labels, header.layers, described, &mut warnings);
    let segments = described
        .into_iter()
        .map(|segment| Segment::new(segment.label, segment.name.as_deref(), segment.rgb))
        .collect();
    let map = LabelMap::new(header.grid.clone(), &labels, segments)
        .map_err(|_| FormatError::Cut { expected: count as u64, found: labels.len() as u64 })?;
    Ok(ReadLabels { map, warnings })
}

/// One label for each voxel. Labels of several layers may be the same for different segments: then segments are numbered in
/// the order in which the file has them.
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
