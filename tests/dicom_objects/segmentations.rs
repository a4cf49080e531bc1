//! Segmentation objects of Relief, read by highdicom, by dciodvfy and by Relief.

use glam::DVec3;
use relief_annotation::Concept;
use relief_base::Transform;
use relief_dicom::{
    LoadLimits, SegmentMeaning, SegmentationError, SegmentationOptions, read_segmentation, write_label_map,
    write_segmentation,
};
use relief_volume::{Grid, LabelMap, Segment};
use serde_json::Value;

use super::common::numbers;
use super::made::{self, oblique_grid};
use super::tools::{dciodvfy, file_of, python};

/// Three bodies that lie nowhere their mirror images would, and a segment without voxels.
pub(crate) fn map(grid: Grid) -> LabelMap {
    let [nx, ny, nz] = grid.dims();
    let mut labels = vec![0u16; nx * ny * nz];
    let mut fill = |label, [x, y, z]: [std::ops::Range<usize>; 3]| {
        for (k, j, i) in z.flat_map(|k| {
            y.clone().flat_map({
                let x = x.clone();
                move |j| x.clone().map(move |i| (k, j, i))
            })
        }) {
            labels[(k * ny + j) * nx + i] = label;
        }
    };
    fill(2, [1..4, 2..3, 0..2]);
    fill(7, [5..9, 4..11, 3..6]);
    fill(300, [0..1, 11..12, 6..7]);
    let segments = vec![
        Segment::new(2, Some("Leber"), Some([0.8, 0.4, 0.2])),
        Segment::new(7, Some("tumour, the second of them"), None),
        Segment::new(9, Some("empty"), None),
        Segment::new(300, None, Some([0.0, 1.0, 0.0])),
    ];
    LabelMap::new(grid, &labels, segments).unwrap()
}

pub(crate) fn options() -> SegmentationOptions {
    let liver =
        Concept { code: "10200004".to_owned(), scheme: "SCT".to_owned(), meaning: "Liver".to_owned() };
    SegmentationOptions {
        made: "2026-02-01T08:09:10.111Z".parse().unwrap(),
        meanings: vec![SegmentMeaning { label: 2, concept: Some(liver), item: None }],
        ..SegmentationOptions::by("Reader^Anna")
    }
}

/// Patient positions of a segment's voxels, sorted.
pub(crate) fn positions(map: &LabelMap, name: &str) -> Vec<DVec3> {
    let place = map.segments().iter().position(|segment| segment.name.as_deref() == Some(name)).unwrap() + 1;
    let [nx, ny, nz] = map.grid().dims();
    let affine = map.grid().patient_from_voxel().affine;
    let all = (0..nx * ny * nz).filter(|&at| map.places().at(at) == place);
    let at = |at: usize| DVec3::new((at % nx) as f64, (at / nx % ny) as f64, (at / nx / ny) as f64);
    sorted(all.map(|index| affine.transform_point3(at(index))).collect())
}

pub(crate) fn sorted(mut positions: Vec<DVec3>) -> Vec<DVec3> {
    positions.sort_by(|a, b| {
        let key = |p: &DVec3| p.to_array().map(|mm| (mm * 100.0).round());
        key(a).partial_cmp(&key(b)).unwrap()
    });
    positions
}

pub(crate) fn apart(a: &[DVec3], b: &[DVec3]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| a.distance(*b)).fold(0.0, f64::max)
}

const NAMES: [(&str, &str); 3] =
    [("Leber", "Leber"), ("tumour, the second of them", "tumour, the second of them"), ("", "Segment 300")];

/// The map with every segment named as a segmentation names it.
fn named(map: &LabelMap) -> LabelMap {
    let labels: Vec<u16> = (0..map.grid().voxel_count())
        .map(|at| map.places().at(at).checked_sub(1).map_or(0, |place| map.segments()[place].label))
        .collect();
    let segments = map.segments().iter().cloned().map(|mut segment| {
        segment.name = segment.name.or_else(|| Some(format!("Segment {}", segment.label)));
        segment
    });
    LabelMap::new(map.grid().clone(), &labels, segments.collect()).unwrap()
}

#[test]
fn a_segmentation_has_the_voxels_of_its_map() {
    let made = made::series();
    // On the series' own grid, on one of other voxels, and mirrored: the third axis against the
    // other two.
    let affine = made.grid.patient_from_voxel().affine;
    let [x, y, z] = [affine.matrix3.x_axis, affine.matrix3.y_axis, affine.matrix3.z_axis];
    let mirrored = Transform::from_axes(x, y, -z, affine.translation);
    let coarse = Grid::axis_aligned([10, 12, 7], [1.5, 0.4, 2.0], [3.0, -7.0, 11.0]).unwrap();
    for grid in [made.grid.clone(), coarse, Grid::new([10, 12, 7], mirrored).unwrap()] {
        let map = named(&map(grid));
        let bytes = write_segmentation(&map, &made.reference, &options()).unwrap();
        let found = read_segmentation(LoadLimits::default(), &bytes).unwrap();
        assert_eq!(found.warnings, Vec::<String>::new());
        for (_, name) in NAMES {
            let off = apart(&positions(&found.map, name), &positions(&map, name));
            assert!(off < 1e-6, "{name}: {off} mm");
        }
        let (_folder, file) = file_of("seg.dcm", &bytes);
        check_by_dcmqi("segmentations read by dcmqi", &file, &map);
        let rgb = found.map.segments()[0].rgb.unwrap();
        assert!(rgb.iter().zip([0.8, 0.4, 0.2]).all(|(a, b)| (a - b).abs() < 0.002), "{rgb:?}");
    }
}

/// Invariant: A report or segmentation carries its patient, study and frame of reference, reads the
/// same in every tool, and no message shows a name or UID.
#[test]
fn label_maps_keep_their_labels_in_every_reader() {
    let made = made::series();
    let coarse = Grid::axis_aligned([9, 13, 7], [1.5, 0.4, 2.0], [3.0, -7.0, 11.0]).unwrap();
    for grid in [made.grid.clone(), coarse] {
        let wide = named(&map(grid));
        // Labels that fit into 8 bits.
        let narrow: Vec<u16> = (0..wide.grid().voxel_count()).map(|at| wide.places().at(at) as u16).collect();
        let segments =
            (1..).zip(wide.segments()).map(|(label, segment)| Segment { label, ..segment.clone() });
        let narrow = LabelMap::new(wide.grid().clone(), &narrow, segments.collect()).unwrap();
        for (map, bits) in [(wide, 16), (narrow, 8)] {
            let bytes = write_label_map(&map, &made.reference, &options()).unwrap();
            assert_eq!(bytes, write_label_map(&map, &made.reference, &options()).unwrap());
            let found = read_segmentation(LoadLimits::default(), &bytes).unwrap();
            assert_eq!(found.warnings, Vec::<String>::new());
            let labels = |map: &LabelMap| map.segments().iter().map(|one| one.label).collect::<Vec<_>>();
            assert_eq!(labels(&found.map), labels(&map));
            for (_, name) in NAMES {
                let off = apart(&positions(&found.map, name), &positions(&map, name));
                assert!(off < 1e-6, "{name}: {off} mm");
            }
            let (_folder, file) = file_of("labelmap.dcm", &bytes);
            let Some(read) = python("label maps read by highdicom", HIGHDICOM, &[&file]) else { continue };
            let read: Value = serde_json::from_str(&read).unwrap();
            assert_eq!(read["kind"], serde_json::json!(["LABELMAP", bits, 0]));
            let segments = read["segments"].as_array().unwrap();
            assert_eq!(segments.len(), map.segments().len());
            for (segment, own) in segments.iter().zip(map.segments()) {
                assert_eq!(
                    (&segment["number"], segment["label"].as_str()),
                    (&own.label.into(), own.name.as_deref())
                );
                let at = segment["at"].as_array().unwrap().iter();
                let at = at.map(|at| DVec3::from_slice(&numbers(at))).collect();
                let off = apart(&sorted(at), &positions(&map, segment["label"].as_str().unwrap()));
                assert!(off < 1e-6, "{}: {off} mm", segment["label"]);
            }
            check_by_dcmqi("label maps read by dcmqi", &file, &map);
            if let Some((errors, _)) = dciodvfy("label maps checked by dciodvfy", &file) {
                // It does not know their SOP class; numbers from one on are for BINARY ones.
                let known = ["Information Object Not found", "not monotonically increasing"];
                let unknown = |line: &&String| !known.iter().any(|words| line.contains(words));
                assert_eq!(errors.iter().filter(unknown).collect::<Vec<_>>(), Vec::<&String>::new());
            }
        }
    }
}

/// The voxels of all segments lie where dcmqi's converter finds them. It numbers the segments of a
/// segmentation from 1, and those of a label map by their labels.
fn check_by_dcmqi(what: &str, file: &std::path::Path, map: &LabelMap) {
    let Some(read) = python(what, DCMQI, &[file]) else { return };
    let read: Value = serde_json::from_str(&read).unwrap();
    let found: Vec<&Value> = read.as_array().unwrap().iter().collect();
    let own = map.segments().iter().map(|own| positions(map, own.name.as_deref().unwrap()));
    let own: Vec<_> = own.filter(|positions| !positions.is_empty()).collect();
    assert_eq!(found.len(), own.len(), "{read}");
    for (found, own) in found.iter().zip(own) {
        let at = found.as_array().unwrap().iter().map(|at| DVec3::from_slice(&numbers(at))).collect();
        let off = apart(&sorted(at), &own);
        assert!(off < 1e-3, "{off} mm"); // its files have six digits
    }
}

const DCMQI: &str = r"
import glob, json, subprocess, sys, tempfile, SimpleITK, numpy as np, dcmqi, os
folder = tempfile.mkdtemp()
program = os.path.join(os.path.dirname(dcmqi.__file__), 'bin', 'segimage2itkimage')
subprocess.run([program, '--inputDICOM', sys.argv[1], '--outputDirectory', folder, '--outputType', 'nrrd'], check=True, stdout=subprocess.DEVNULL)
found = []
for path in glob.glob(folder + '/*.nrrd'):
    image = SimpleITK.ReadImage(path)
    values = SimpleITK.GetArrayFromImage(image)
    for label in np.unique(values[values != 0]):
        at = np.argwhere(values == label)[:, ::-1]
        found.append([int(label), [image.TransformIndexToPhysicalPoint([int(i) for i in one]) for one in at]])
found.sort(key=lambda one: one[0])
print(json.dumps([at for label, at in found]))
";

const HIGHDICOM: &str = r"
import json, sys, numpy as np, highdicom as hd
seg = hd.seg.segread(sys.argv[1])
volume = seg.get_volume(combine_segments=True)
found = {'segments': [], 'patient': str(seg.PatientName), 'frame': seg.FrameOfReferenceUID,
         'sources': sum('DerivationImageSequence' in g for g in seg.PerFrameFunctionalGroupsSequence),
         'referenced': len(seg.ReferencedSeriesSequence[0].ReferencedInstanceSequence) if 'ReferencedSeriesSequence' in seg else 0,
         'kind': [seg.SegmentationType, seg.BitsAllocated, seg.get('PixelPaddingValue')]}
for number in seg.segment_numbers:
    described = seg.get_segment_description(number)
    at = np.argwhere(volume.array == number)
    found['segments'].append({'number': int(number), 'label': described.segment_label, 'type': described.segmented_property_type.meaning,
        'at': volume.map_indices_to_reference(at).tolist() if len(at) else []})
print(json.dumps(found))
";

/// Invariant: A report or segmentation carries its patient, study and frame of reference, reads the
/// same in every tool, and no message shows a name or UID.
#[test]
fn highdicom_finds_the_same_voxels() {
    let made = made::series();
    let map = named(&map(made.grid.clone()));
    let bytes = write_segmentation(&map, &made.reference, &options()).unwrap();
    let (_folder, file) = file_of("seg.dcm", &bytes);
    let Some(found) = python("segmentations read by highdicom", HIGHDICOM, &[&file]) else { return };
    let found: Value = serde_json::from_str(&found).unwrap();
    assert_eq!(found["frame"], made.frame_of_reference.as_str());
    assert_eq!(found["patient"], "PHANTOM^MÜNZE");
    assert_eq!(
        (&found["sources"], &found["referenced"]),
        (&6.into(), &7.into()),
        "every frame has its slice"
    );
    let segments = found["segments"].as_array().unwrap();
    assert_eq!(segments.len(), 4);
    assert_eq!(segments[0]["type"], "Liver");
    for segment in segments.iter().filter(|segment| segment["label"] != "empty") {
        let at = segment["at"].as_array().unwrap().iter().map(|at| DVec3::from_slice(&numbers(at))).collect();
        let off = apart(&sorted(at), &positions(&map, segment["label"].as_str().unwrap()));
        assert!(off < 1e-6, "{}: {off} mm", segment["label"]);
    }
}

#[test]
fn dciodvfy_finds_no_fault_in_segmentations() {
    let made = made::series();
    let coarse = Grid::axis_aligned([9, 12, 7], [1.5, 0.4, 2.0], [3.0, -7.0, 11.0]).unwrap();
    for grid in [made.grid.clone(), coarse] {
        let bytes = write_segmentation(&map(grid), &made.reference, &options()).unwrap();
        let (_folder, file) = file_of("seg.dcm", &bytes);
        let Some((errors, warnings)) = dciodvfy("segmentations checked by dciodvfy", &file) else { return };
        assert_eq!(errors, Vec::<String>::new());
        let unknown: Vec<&String> =
            warnings.iter().filter(|line| !line.contains("needed to build DICOMDIR")).collect();
        assert!(unknown.is_empty(), "{unknown:#?}");
    }
}

#[test]
fn invalid_frames_are_refused() {
    let made = made::series();
    let refused = |map: &LabelMap| write_segmentation(map, &made.reference, &options()).unwrap_err();
    let empty = LabelMap::new(oblique_grid([2, 2, 2]), &[0; 8], Vec::new()).unwrap();
    assert!(matches!(refused(&empty), SegmentationError::Nothing));
    let sheared = Transform::from_axes(DVec3::X, DVec3::Y, DVec3::new(0.1, 0.0, 1.0), DVec3::ZERO);
    let sheared = LabelMap::new(Grid::new([2, 2, 2], sheared).unwrap(), &[1; 8], Vec::new()).unwrap();
    let message = refused(&sheared).to_string();
    assert!(message.contains("5.71") && message.contains("resample"), "{message}");
}
