//! Segments that overlap: each whole in a segmentation of Relief, as highdicom reads it, and in one
//! of highdicom, as Relief does.

use glam::DVec3;
use relief_dicom::{
    LoadLimits, SegmentationError, read_segmentation, read_segmentation_layers, write_segmentation_layers,
};
use relief_volume::{Grid, LabelMap, Layers, Segment};
use serde_json::Value;

use super::common::numbers;
use super::made;
use super::segmentations::{apart, options, positions, sorted};
use super::tools::{dciodvfy, file_of, python};

/// Indices of the voxels of a box.
fn block(grid: &Grid, [x, y, z]: [std::ops::Range<usize>; 3]) -> Vec<usize> {
    let [nx, ny, _] = grid.dims();
    let rows = z.flat_map(|k| y.clone().map(move |j| (k * ny + j) * nx));
    rows.flat_map(|row| x.clone().map(move |i| row + i)).collect()
}

/// A tumour in a liver, a vessel through both, and something far away: two layers of two, or three.
fn layers(grid: &Grid) -> Vec<LabelMap> {
    let mut layers = Layers::new(grid.clone(), 1 << 20);
    for (label, name, voxels) in [
        (1, "liver", block(grid, [1..8, 2..10, 1..6])),
        (2, "tumour", block(grid, [3..6, 4..7, 2..4])),
        (3, "vessel", block(grid, [4..5, 0..12, 3..4])),
        (4, "far away", block(grid, [9..10, 11..12, 6..7])),
    ] {
        layers.add(Segment::new(label, Some(name), None), voxels.into_iter()).unwrap();
    }
    layers.into_maps()
}

/// The map that has a segment, and how many voxels it has there.
fn holding<'a>(maps: &'a [LabelMap], name: &str) -> (&'a LabelMap, u64) {
    let of = |map: &'a LabelMap| map.counted().map(move |(segment, voxels)| (map, segment, voxels));
    let found = maps.iter().flat_map(of).find(|(_, segment, _)| segment.name.as_deref() == Some(name));
    let (map, _, voxels) = found.unwrap_or_else(|| panic!("no {name}"));
    (map, voxels)
}

const NAMES: [(&str, u64); 4] =
    [("liver", 7 * 8 * 5), ("tumour", 3 * 3 * 2), ("vessel", 12), ("far away", 1)];

/// Invariant: Overlapping segments are exchanged completely, as highdicom, 3D Slicer, pynrrd and
/// slicerio read them.
#[test]
fn segments_that_overlap_come_back_whole() {
    let made = made::series();
    let maps = layers(&made.grid);
    assert_eq!(maps.len(), 3);
    let bytes = write_segmentation_layers(&maps, &made.reference, &options()).unwrap();
    let found = read_segmentation_layers(LoadLimits::default(), &bytes).unwrap();
    assert_eq!((found.layers.len(), found.warnings), (3, Vec::new()));
    for (name, voxels) in NAMES {
        let ((map, count), (known, _)) = (holding(&found.layers, name), holding(&maps, name));
        assert_eq!(count, voxels, "{name}");
        assert!(apart(&positions(map, name), &positions(known, name)) < 1e-6, "{name}");
    }
    // In a single map the upper segment hides the lower one, with a warning.
    let flat = read_segmentation(LoadLimits::default(), &bytes).unwrap();
    assert_eq!(flat.map.labelled_voxels(), 7 * 8 * 5 + 4 + 1, "{:?}", flat.warnings);
    assert!(flat.warnings[0].contains("overlap"), "{:?}", flat.warnings);
    // Layers count towards the limits together.
    let one = LoadLimits { voxel_bytes: 2 * 10 * 12 * 7 };
    let refused = read_segmentation_layers(one, &bytes).unwrap_err().to_string();
    assert!(refused.contains("overlap so much"), "{refused}");
    let other = Grid::axis_aligned([2, 2, 2], [1.0; 3], [0.0; 3]).unwrap();
    let other = LabelMap::new(other, &[9; 8], Vec::new()).unwrap();
    let mixed: Vec<LabelMap> = maps.into_iter().chain([other]).collect();
    let refused = write_segmentation_layers(&mixed, &made.reference, &options()).unwrap_err();
    assert!(matches!(refused, SegmentationError::Grids), "{refused}");
}

const READ: &str = r"
import json, sys, numpy as np, highdicom as hd
seg = hd.seg.segread(sys.argv[1])
found = []
for number in seg.segment_numbers:
    volume = seg.get_volume(segment_numbers=[number], combine_segments=False)
    at = np.argwhere(np.squeeze(volume.array, -1) > 0)
    found.append({'label': seg.get_segment_description(number).segment_label,
                  'at': volume.map_indices_to_reference(at).tolist()})
print(json.dumps(found))
";

fn same_voxels(found: &str, maps: &[LabelMap]) {
    let found: Value = serde_json::from_str(found).unwrap();
    let found = found.as_array().unwrap();
    assert_eq!(found.len(), NAMES.len());
    for (segment, (name, voxels)) in found.iter().zip(NAMES) {
        assert_eq!(segment["label"], name);
        let at = segment["at"].as_array().unwrap().iter().map(|at| DVec3::from_slice(&numbers(at)));
        let (at, own) = (sorted(at.collect()), positions(holding(maps, name).0, name));
        assert_eq!((at.len() as u64, own.len() as u64), (voxels, voxels), "{name}");
        assert!(apart(&at, &own) < 1e-6, "{name}");
    }
}

/// Invariant: Overlapping segments are exchanged completely, as highdicom, 3D Slicer, pynrrd and
/// slicerio read them.
#[test]
fn highdicom_finds_every_segment_whole() {
    let made = made::series();
    let maps = layers(&made.grid);
    let bytes = write_segmentation_layers(&maps, &made.reference, &options()).unwrap();
    let (_folder, file) = file_of("seg.dcm", &bytes);
    if let Some(found) = python("overlapping segments read by highdicom", READ, &[&file]) {
        same_voxels(&found, &maps);
    }
    if let Some((errors, _)) = dciodvfy("overlapping segments checked by dciodvfy", &file) {
        assert_eq!(errors, Vec::<String>::new());
    }
}

const WRITE: &str = r"
import glob, sys, numpy as np, highdicom as hd, pydicom
from pydicom.sr.codedict import codes
folder, out = sys.argv[1:]
images = sorted((pydicom.dcmread(path) for path in glob.glob(folder + '/*.dcm')), key=lambda one: int(one.InstanceNumber))
def z(one):
    row, column = np.array(one.ImageOrientationPatient, dtype=float).reshape(2, 3)
    return float(np.cross(row, column) @ np.array(one.ImagePositionPatient, dtype=float))
images.sort(key=z)
masks = np.zeros((7, 12, 10, 4), np.uint8)
masks[1:6, 2:10, 1:8, 0] = 1
masks[2:4, 4:7, 3:6, 1] = 1
masks[3:4, 0:12, 4:5, 2] = 1
masks[6:7, 11:12, 9:10, 3] = 1
described = [hd.seg.SegmentDescription(segment_number=n, segment_label=name, segmented_property_category=codes.SCT.Tissue,
    segmented_property_type=codes.SCT.Tissue, algorithm_type=hd.seg.SegmentAlgorithmTypeValues.MANUAL)
    for n, name in enumerate(['liver', 'tumour', 'vessel', 'far away'], 1)]
seg = hd.seg.Segmentation(source_images=images, pixel_array=masks, segmentation_type=hd.seg.SegmentationTypeValues.BINARY,
    segment_descriptions=described, series_instance_uid=hd.UID(), series_number=2, sop_instance_uid=hd.UID(),
    instance_number=1, manufacturer='none', manufacturer_model_name='none', software_versions='1', device_serial_number='1')
seg.save_as(out)
";

/// Invariant: Overlapping segments are exchanged completely, as highdicom, 3D Slicer, pynrrd and
/// slicerio read them.
#[test]
fn overlapping_segments_of_highdicom_are_read_whole() {
    let made = made::series();
    let file = made.folder.path().join("theirs.dcm");
    let arguments = [&*made.folder.path().join("ct"), &*file];
    if python("overlapping segments written by highdicom", WRITE, &arguments).is_none() {
        return;
    }
    let found = read_segmentation_layers(LoadLimits::default(), &std::fs::read(&file).unwrap()).unwrap();
    assert_eq!(found.layers.len(), 3, "{:?}", found.warnings);
    if let Some(theirs) = python("overlapping segments read by highdicom", READ, &[&file]) {
        same_voxels(&theirs, &found.layers);
    }
}
