//! The rule for what may share a volume: groups of slices that become one series each.
//!
//! | Slices differ in | Effect |
//! |---|---|
//! | patient, study, series or frame of reference | separate: positions and people are not comparable |
//! | RescaleType | separate: HU and other quantities are not comparable |
//! | SOP class, matrix size, pixel spacing, orientation, StackID | separate: no common grid |
//! | derivation, kernel, energy, thickness | separate where their ranges along the normal overlap: between the slices of one kind lie those of another. One behind the other they are one stack, with [`WarningCode::MixedSlices`] |
//! | temporal position, AcquisitionNumber | separate where they overlap by more than [`FEW_SLICES`]: passes of one region. Rotations of step-and-shoot scans meet, and are one stack; where they overlap, with [`WarningCode::MixedSlices`] |
//! | nothing of these, but more than a quarter of the positions repeat | phases: separate by the first attribute that leaves each phase one slice at a position; else by their order in time |
//!
//! Files of one image (the same SOPInstanceUID at the same position) count once, with a warning.
//! A slice that repeats a position of its own stack is left out later, with a warning
//! ([`stack::arrange`]); many are refused there.
//!
//! Groups of one SeriesInstanceUID have `#1`, `#2` appended to it: most slices first, phases in
//! their order. The UID is compared as it is, so slices without one are
//! distinguished by study.

use std::collections::{BTreeMap, HashMap, HashSet};
use std::sync::Arc;

use glam::DVec3;

use super::attributes::quoted;
use super::distinctions::Distinction;
use super::header::FrameHeader;
use super::series::{Phase, SeriesEntry};
use super::stack;
use super::warnings::{Warning, WarningCode};
use relief_base::Budget;

/// The largest difference of unit vectors in one series: they are written with at least four digits.
const DIRECTION_TOLERANCE: f64 = 1e-3;
/// The largest difference of pixel spacings in one series, as a fraction.
const SPACING_TOLERANCE: f64 = 1e-3;

/// Rotations of one pass may overlap by this number of slices.
const FEW_SLICES: usize = 2;

/// The least mean number of slices of a pass. Smaller groups are rotations.
const LEAST_PASS: usize = 4;

/// Attributes of images that may not lie between each other.
const KINDS: [Distinction; 4] =
    [Distinction::ImageType, Distinction::Kernel, Distinction::Energy, Distinction::Thickness];

/// Attributes of passes over the patient.
const PASSES: [Distinction; 2] = [Distinction::TemporalPosition, Distinction::Acquisition];

/// Attributes that may distinguish images at one position.
const PHASES: [Distinction; 6] = [
    Distinction::TemporalPosition,
    Distinction::Acquisition,
    Distinction::TriggerTime,
    Distinction::AcquisitionTime,
    Distinction::ContentTime,
    Distinction::Description,
];

/// Slices that may share a volume, and how they differ from others of their SeriesInstanceUID.
struct Group {
    frames: Vec<FrameHeader>,
    /// For lists to choose from: "patient 2", "ConvolutionKernel (0018,1210) \"B70s\"".
    differs: Vec<String>,
    /// Its number among the phases of one region.
    phase: Option<Phase>,
    /// Number of that region.
    region: usize,
    warnings: Vec<Warning>,
}

/// Groups slices into series, in a stable order: by UID, then by size, most slices first.
pub(super) fn group(frames: Vec<FrameHeader>, budget: &Budget) -> Vec<SeriesEntry> {
    let mut by_uid: BTreeMap<String, Vec<FrameHeader>> = BTreeMap::new();
    for frame in frames {
        by_uid.entry(frame.file.series_uid.clone()).or_default().push(frame);
    }
    by_uid.into_iter().flat_map(|(uid, frames)| of_uid(&uid, frames, budget)).collect()
}

fn of_uid(uid: &str, frames: Vec<FrameHeader>, budget: &Budget) -> Vec<SeriesEntry> {
    let all = Group { frames, differs: Vec::new(), phase: None, region: 0, warnings: Vec::new() };
    let mut groups = vec![all];
    groups = each(groups, |group| by_number(group, "patient", |frame| frame.file.patient));
    groups = each(groups, |group| by_number(group, "study", |frame| frame.file.study_uid.clone()));
    let frame_of_reference = |frame: &FrameHeader| frame.file.frame_of_reference_uid.clone();
    groups = each(groups, |group| by_number(group, "frame of reference", frame_of_reference));
    groups = each(groups, without_copies);
    groups = each(groups, |group| by_value(group, Distinction::Quantity));
    groups = each(groups, by_shape);
    groups = each(groups, |group| by_value(group, Distinction::Stack));
    for kind in KINDS {
        groups =
            each(groups, |group| if overlap(&group, kind) > 0 { by_value(group, kind) } else { vec![group] });
    }
    for pass in PASSES {
        groups = each(groups, |group| by_pass(group, pass));
    }
    groups = each(groups, by_phase);
    let mut regions = 0;
    for group in &mut groups {
        // The phases of a region follow one another.
        regions += usize::from(group.phase.is_some_and(|phase| phase.number == 1));
        group.region = regions;
    }
    groups.sort_by_key(|group| std::cmp::Reverse(group.frames.len()));
    let several = groups.len() > 1;
    let name = |index: usize| if several { format!("{uid}#{}", index + 1) } else { uid.to_owned() };
    let entry = |(index, mut group): (usize, Group)| {
        let mixed = mixed(&group);
        group.warnings.extend(mixed);
        SeriesEntry::new(name(index), group.frames, group.differs, group.warnings, budget)
            .in_phase(group.phase, group.region)
    };
    groups.into_iter().enumerate().map(entry).collect()
}

fn each(groups: Vec<Group>, divide: impl Fn(Group) -> Vec<Group>) -> Vec<Group> {
    groups.into_iter().flat_map(divide).collect()
}

impl Group {
    /// Parts of this group; each says how it differs if there are several.
    fn into_parts(self, parts: Vec<(String, Vec<FrameHeader>)>) -> Vec<Self> {
        let several = parts.len() > 1;
        let part = |(differs, frames)| {
            let added = several.then_some(differs);
            let differs = self.differs.iter().cloned().chain(added).collect();
            Self { frames, differs, phase: self.phase, region: self.region, warnings: self.warnings.clone() }
        };
        parts.into_iter().map(part).collect()
    }

    /// Heights of frames along the normal of the first one, mm.
    fn heights_mm(&self) -> Vec<f64> {
        let normal = stack::normal(&self.frames[0]);
        self.frames.iter().map(|frame| frame.position.dot(normal)).collect()
    }
}

/// Separates by an identity that no message may show.
fn by_number<K: Ord>(group: Group, what: &str, key: impl Fn(&FrameHeader) -> K) -> Vec<Group> {
    let mut parts: BTreeMap<K, Vec<FrameHeader>> = BTreeMap::new();
    for frame in &group.frames {
        parts.entry(key(frame)).or_default().push(frame.clone());
    }
    let parts = parts.into_values().enumerate();
    let parts = parts.map(|(index, frames)| (format!("{what} {}", index + 1), frames)).collect();
    group.into_parts(parts)
}

/// Leaves out files that hold an image found already, as folders with backups have them: the same
/// SOP Instance UID at the same position (some anonymisers give all slices one UID).
fn without_copies(mut group: Group) -> Vec<Group> {
    let mut seen = HashSet::new();
    let mut copies = Vec::new();
    let mut kept = Vec::with_capacity(group.frames.len());
    for frame in group.frames {
        let instance = frame.file.instance_uid.clone();
        let position = frame.position.to_array().map(f64::to_bits);
        if instance.is_empty() || seen.insert((instance, frame.index, position)) {
            kept.push(frame);
        } else {
            copies.push(frame.to_string());
        }
    }
    if let Some(first) = copies.first() {
        let message = format!(
            "{} image(s) found twice (same SOPInstanceUID (0008,0018)); left out, first: {first}",
            copies.len()
        );
        group.warnings.push(Warning::new(WarningCode::DuplicateFile, message));
    }
    vec![Group { frames: kept, ..group }]
}

/// Separates slices that cannot share a grid.
fn by_shape(group: Group) -> Vec<Group> {
    let mut shapes: Vec<Vec<FrameHeader>> = Vec::new();
    // Comparing each slice with the first of each group of its size stays fast with thousands of
    // odd files.
    let mut candidates: HashMap<(u32, u32, String), Vec<usize>> = HashMap::new();
    for frame in &group.frames {
        let layout = &frame.file.layout;
        let key = (layout.rows, layout.columns, frame.file.sop_class.clone());
        let of_size = candidates.entry(key).or_default();
        match of_size.iter().find(|&&shape| same_shape(&shapes[shape][0], frame)) {
            Some(&shape) => shapes[shape].push(frame.clone()),
            None => {
                of_size.push(shapes.len());
                shapes.push(vec![frame.clone()]);
            }
        }
    }
    // Lists show the size and the spacing.
    let warnings = group.warnings;
    let part = |frames| Group {
        frames,
        differs: group.differs.clone(),
        phase: group.phase,
        region: group.region,
        warnings: warnings.clone(),
    };
    shapes.into_iter().map(part).collect()
}

fn same_shape(a: &FrameHeader, b: &FrameHeader) -> bool {
    let near = |a: DVec3, b: DVec3| (a - b).abs().max_element() < DIRECTION_TOLERANCE;
    let spacing = (0..2).all(|axis| {
        let (a, b) = (a.spacing_mm[axis], b.spacing_mm[axis]);
        (a - b).abs() < a.max(b) * SPACING_TOLERANCE
    });
    spacing && near(a.row, b.row) && near(a.column, b.column)
}

/// Indices of frames by their value of an attribute: numbers in their order, before other texts.
fn values(frames: &[FrameHeader], of: Distinction) -> Vec<(&str, Vec<usize>)> {
    let mut values: HashMap<&str, Vec<usize>> = HashMap::new();
    for (index, frame) in frames.iter().enumerate() {
        values.entry(frame.distinctions.get(of)).or_default().push(index);
    }
    let mut values: Vec<_> = values.into_iter().collect();
    let number = |text: &str| text.parse().unwrap_or(f64::INFINITY);
    values.sort_by(|(a, _), (b, _)| number(a).total_cmp(&number(b)).then_with(|| a.cmp(b)));
    values
}

fn by_value(group: Group, of: Distinction) -> Vec<Group> {
    let parts = values(&group.frames, of).into_iter().enumerate().map(|(index, (value, frames))| {
        // A description may name a patient, and times help to identify one.
        let value = if of == Distinction::Description || of.is_time() {
            format!("number {}", index + 1)
        } else {
            quoted(value)
        };
        let frames = frames.into_iter().map(|frame| group.frames[frame].clone()).collect();
        (format!("{} {value}", of.attribute()), frames)
    });
    let parts = parts.collect();
    group.into_parts(parts)
}

/// The largest number of slices of one value that lie strictly between slices of another.
fn overlap(group: &Group, of: Distinction) -> usize {
    let values = values(&group.frames, of);
    if values.len() < 2 {
        return 0;
    }
    let heights = group.heights_mm();
    let sorted = |(_, frames): (&str, Vec<usize>)| {
        let mut own: Vec<f64> = frames.into_iter().map(|frame| heights[frame]).collect();
        own.sort_by(f64::total_cmp);
        own
    };
    let mut ranges: Vec<Vec<f64>> = values.into_iter().map(sorted).collect();
    ranges.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let margin = stack::rounding_mm(group.frames[0].spacing_mm);
    let inside = |heights: &[f64], range: &[f64]| {
        let (low, high) = (range[0] + margin, range[range.len() - 1] - margin);
        let before_high = heights.partition_point(|&height| height < high);
        before_high.saturating_sub(heights.partition_point(|&height| height <= low))
    };
    let mut most = 0;
    // Where any ranges overlap, the one that reaches farthest so far overlaps the next.
    let mut farthest = 0;
    for next in 1..ranges.len() {
        let (a, b) = (&ranges[farthest], &ranges[next]);
        most = most.max(inside(a, b)).max(inside(b, a));
        if b[b.len() - 1] > a[a.len() - 1] {
            farthest = next;
        }
    }
    most
}

/// Separates passes over one region.
fn by_pass(group: Group, of: Distinction) -> Vec<Group> {
    let passes = values(&group.frames, of).len();
    let are_passes = group.frames.len() >= LEAST_PASS * passes;
    if !are_passes || overlap(&group, of) <= FEW_SLICES {
        return vec![group];
    }
    let parts = by_value(group, of);
    if at_same_places(&parts) { as_phases(parts) } else { parts }
}

/// Whether all groups have slices at the same heights.
fn at_same_places(groups: &[Group]) -> bool {
    let sorted = |group: &Group| {
        let mut heights = group.heights_mm();
        heights.sort_by(f64::total_cmp);
        heights
    };
    let first = sorted(&groups[0]);
    let margin = stack::rounding_mm(groups[0].frames[0].spacing_mm);
    groups[1..].iter().map(sorted).all(|heights| {
        heights.len() == first.len() && heights.iter().zip(&first).all(|(a, b)| (a - b).abs() <= margin)
    })
}

/// Numbers groups that are the phases of one region, in their order.
fn as_phases(groups: Vec<Group>) -> Vec<Group> {
    let count = groups.len();
    let numbered = |(index, group)| Group { phase: Some(Phase { number: index + 1, count }), ..group };
    groups.into_iter().enumerate().map(numbered).collect()
}

/// Separates phases, where many positions repeat.
fn by_phase(group: Group) -> Vec<Group> {
    let duplicates = stack::duplicates(&group.frames);
    if !stack::are_many(duplicates.len(), group.frames.len()) {
        return vec![group];
    }
    let mut times_kept: HashMap<usize, usize> = HashMap::new();
    for (_, kept) in &duplicates {
        *times_kept.entry(*kept).or_default() += 1;
    }
    let repeats = 1 + times_kept.values().copied().max().unwrap_or(0);
    let divides = |of: &Distinction| {
        let values = values(&group.frames, *of);
        // A clock that differs from slice to slice divides anything.
        let is_phase = values.len() > 1 && (values.len() == repeats || !of.is_time());
        is_phase
            && values.iter().all(|(_, frames)| {
                let frames: Vec<FrameHeader> =
                    frames.iter().map(|&frame| group.frames[frame].clone()).collect();
                stack::duplicates(&frames).is_empty()
            })
    };
    if let Some(of) = KINDS.into_iter().find(divides) {
        return by_value(group, of);
    }
    if let Some(of) = PHASES.into_iter().find(divides) {
        return as_phases(by_value(group, of));
    }
    let parts = by_file(&group, repeats).or_else(|| by_order_in_time(&group, &duplicates, repeats));
    match parts {
        Some(parts) => {
            let parts = parts.into_iter().enumerate();
            let parts = parts.map(|(index, frames)| (format!("phase {}", index + 1), frames)).collect();
            as_phases(group.into_parts(parts))
        }
        None => vec![group],
    }
}

/// The frames of each object, where each object of several frames is a phase.
fn by_file(group: &Group, repeats: usize) -> Option<Vec<Vec<FrameHeader>>> {
    let mut objects: Vec<Vec<FrameHeader>> = Vec::new();
    let mut places = HashMap::new();
    for frame in &group.frames {
        let place = *places.entry(Arc::as_ptr(&frame.file)).or_insert(objects.len());
        match objects.get_mut(place) {
            Some(object) => object.push(frame.clone()),
            None => objects.push(vec![frame.clone()]),
        }
    }
    let is_phase = |object: &Vec<FrameHeader>| object.len() > 1 && stack::duplicates(object).is_empty();
    (objects.len() == repeats && objects.iter().all(is_phase)).then_some(objects)
}

/// Images that were taken one after the other: at each position the first ones, the second ones and
/// so on, where each image of a phase is earlier than all of the next.
fn by_order_in_time(
    group: &Group,
    duplicates: &[(usize, usize)],
    repeats: usize,
) -> Option<Vec<Vec<FrameHeader>>> {
    let left_out: HashSet<usize> = duplicates.iter().map(|&(index, _)| index).collect();
    let mut positions: HashMap<usize, Vec<usize>> =
        (0..group.frames.len()).filter(|index| !left_out.contains(index)).map(|at| (at, vec![at])).collect();
    for &(index, kept) in duplicates {
        positions.entry(kept).or_default().push(index);
    }
    if positions.values().any(|frames| frames.len() != repeats) {
        return None;
    }
    [Distinction::AcquisitionTime, Distinction::ContentTime].into_iter().find_map(|clock| {
        let time = |frame: usize| group.frames[frame].distinctions.get(clock).parse::<f64>().ok();
        let mut phases: Vec<Vec<(f64, usize)>> = vec![Vec::new(); repeats];
        for frames in positions.values() {
            let timed: Option<Vec<_>> = frames.iter().map(|&frame| Some((time(frame)?, frame))).collect();
            let mut timed = timed?;
            timed.sort_by(|a, b| a.0.total_cmp(&b.0));
            phases.iter_mut().zip(timed).for_each(|(phase, frame)| phase.push(frame));
        }
        let earliest =
            |phase: &[(f64, usize)]| phase.iter().map(|frame| frame.0).fold(f64::INFINITY, f64::min);
        let latest =
            |phase: &[(f64, usize)]| phase.iter().map(|frame| frame.0).fold(f64::NEG_INFINITY, f64::max);
        let in_order = phases.windows(2).all(|pair| latest(&pair[0]) < earliest(&pair[1]));
        let frames = |phase: Vec<(f64, usize)>| {
            let mut frames: Vec<usize> = phase.into_iter().map(|(_, frame)| frame).collect();
            frames.sort_unstable();
            frames.into_iter().map(|frame| group.frames[frame].clone()).collect()
        };
        in_order.then(|| phases.into_iter().map(frames).collect())
    })
}

/// A warning for each attribute of the images in which slices of one stack differ, and for passes
/// that overlap by few slices.
fn mixed(group: &Group) -> Vec<Warning> {
    let warning = |of: Distinction| {
        let values = values(&group.frames, of);
        let listed: Vec<String> =
            values.iter().take(4).map(|(value, of)| format!("{} have {}", of.len(), quoted(value))).collect();
        let more = if values.len() > 4 { ", ..." } else { "" };
        let message = format!("slices differ in {}: {}{more}", of.attribute(), listed.join(", "));
        (values.len() > 1).then(|| Warning::new(WarningCode::MixedSlices, message))
    };
    let overlapping = PASSES.into_iter().filter(|pass| overlap(group, *pass) > 0);
    KINDS.into_iter().chain(overlapping).filter_map(warning).collect()
}
