//! RT structure sets of two planning systems, contour by contour as pydicom has them.

use relief_annotation::{Contour, Geometry, fill_contours};
use relief_dicom::ContourShape;
use relief_volume::Mask;
use serde_json::Value;

use super::common::{facts, numbers, shared_data, unpacked};
use super::tools::python;

const PYDICOM: &str = r"
import json, sys, pydicom
data = pydicom.dcmread(sys.argv[1])
names = {roi.ROINumber: roi.ROIName for roi in data.StructureSetROISequence}
found = []
for roi in data.ROIContourSequence:
    contours = [{'type': c.ContourGeometricType, 'data': [float(x) for x in c.ContourData]}
                for c in roi.get('ContourSequence', [])]
    found.append({'name': names[roi.ReferencedROINumber], 'color': [int(x) for x in roi.get('ROIDisplayColor', [])], 'contours': contours})
print(json.dumps(found))
";

#[test]
fn contours_are_those_that_pydicom_reads() {
    for (series, file) in [
        ("sts-001-thigh", "rtstruct/RS.dcm"),
        ("catphan504-cbct", "rtstruct/RS.1.2.246.352.61.4.4629243971856054928.10351809266615445418.dcm"),
    ] {
        let Some(folder) = unpacked("an RT structure set", series, &[]) else { continue };
        let file = folder.join(file);
        let found = relief_dicom::read_structure_set(&std::fs::read(&file).unwrap()).unwrap();
        let Some(peer) = python("structure sets read by pydicom", PYDICOM, &[&file]) else { return };
        let peer: Vec<Value> = serde_json::from_str(&peer).unwrap();
        assert_eq!(found.structures.len(), peer.len(), "{series}");
        let mut count = (0, 0);
        for (structure, peer) in found.structures.iter().zip(&peer) {
            assert_eq!(structure.name, peer["name"].as_str().unwrap());
            let rgb = structure.rgb.map_or(Vec::new(), |rgb| rgb.map(|channel| channel * 255.0).to_vec());
            assert_eq!(rgb, numbers(&peer["color"]), "{}", structure.name);
            let contours = peer["contours"].as_array().unwrap();
            assert_eq!(structure.contours.len(), contours.len(), "{}", structure.name);
            for (contour, peer) in structure.contours.iter().zip(contours) {
                let shape = match peer["type"].as_str().unwrap() {
                    "CLOSED_PLANAR" => ContourShape::Closed,
                    "POINT" => ContourShape::Point,
                    other => panic!("{other}"),
                };
                assert_eq!(contour.shape, shape);
                let ours: Vec<f64> =
                    contour.points_mm.iter().flat_map(|point| point.xyz.to_array()).collect();
                assert_eq!(ours, numbers(&peer["data"])[..ours.len()], "{}", structure.name);
                count = (count.0 + 1, count.1 + contour.points_mm.len());
            }
        }
        println!("{series}: {} structures, {} contours, {} points", found.structures.len(), count.0, count.1);
    }
}

#[test]
fn a_tumour_has_its_levels_and_becomes_items() {
    let Some(folder) = unpacked("an RT structure set", "sts-001-thigh", &[]) else { return };
    let facts = facts(&shared_data("an RT structure set", &[]).unwrap(), "sts-001-thigh.mask.facts.json");
    let found =
        relief_dicom::read_structure_set(&std::fs::read(folder.join("rtstruct/RS.dcm")).unwrap()).unwrap();
    let tumour = &found.structures[0];
    assert_eq!((tumour.name.as_str(), tumour.kind.as_deref()), ("GTV_Mass_CT", Some("GTV")));
    assert_eq!(tumour.contours.len() as u64, facts["rtstruct_n_contours"][0].as_u64().unwrap());
    let levels = tumour.levels_mm();
    assert!(
        levels.len() > 20 && levels.windows(2).all(|pair| (pair[1] - pair[0] - 3.27).abs() < 0.02),
        "{levels:?}"
    );
    let points = || tumour.contours.iter().flat_map(|contour| &contour.points_mm).map(|point| point.xyz);
    let [low, high] =
        [points().reduce(glam::DVec3::min), points().reduce(glam::DVec3::max)].map(Option::unwrap);
    for (found, bound) in [low, high].into_iter().zip(facts["rtstruct_contour_bbox_lps"].as_array().unwrap())
    {
        assert!(found.abs_diff_eq(glam::DVec3::from_slice(&numbers(bound)), 1e-3), "{found}");
    }
    let (items, warnings) = found.items("importer").unwrap();
    assert_eq!((items.len(), warnings.len()), (32, 0));
    assert!(items.iter().all(|item| item.validate().is_ok() && item.list == "GTV_Mass_CT"));
    assert!(matches!(items[0].geometry, Some(Geometry::Curve { closed: true, .. })));
    assert_eq!((items[31].name.as_str(), items[31].rgb), ("GTV_Mass_CT 32", Some([1.0, 0.0, 0.0])));
    assert!(!format!("{found:?}").contains("1.3.6.1"), "a UID is shown");
}

/// Filled, the contours are the region that another program made of them.
#[test]
fn contours_filled_are_the_published_mask() {
    let Some(folder) = unpacked("an RT structure set", "sts-001-thigh", &[]) else { return };
    let truth = relief_dicom::read_labels(&folder.join("nifti_mask/mask.nii.gz")).unwrap().map;
    let truth = Mask::of_label(&truth, 1);
    let found =
        relief_dicom::read_structure_set(&std::fs::read(folder.join("rtstruct/RS.dcm")).unwrap()).unwrap();
    let closed = found.structures[0].contours.iter().filter(|contour| contour.is_closed());
    let contours: Vec<Contour> =
        closed.map(|contour| Contour { points: contour.points_mm.clone() }).collect();
    let filled = fill_contours(truth.grid(), &contours).unwrap();
    let both: u64 =
        filled.words().iter().zip(truth.words()).map(|(a, b)| u64::from((a & b).count_ones())).sum();
    let dice = 2.0 * both as f64 / (filled.voxels() + truth.voxels()) as f64;
    println!("{} voxels for {}, Dice {dice:.4}", filled.voxels(), truth.voxels());
    assert!(dice > 0.98, "{dice}");
}

#[test]
fn other_objects_and_bad_numbers_are_refused_by_name() {
    let Some(folder) = unpacked("an RT structure set", "sts-001-thigh", &[]) else { return };
    let image = std::fs::read(folder.join("000000.dcm")).unwrap();
    let refused = relief_dicom::read_structure_set(&image).unwrap_err().to_string();
    assert_eq!(refused, "Modality (0008,0060): found \"CT\", expected RTSTRUCT, an RT structure set");
    let mut bytes = std::fs::read(folder.join("rtstruct/RS.dcm")).unwrap();
    let data = [0x06, 0x30, 0x50, 0x00]; // (3006,0050), implicit VR: four bytes of length follow
    let at = bytes.windows(4).position(|window| window == data).unwrap();
    bytes[at + 8] = b'x';
    let refused = relief_dicom::read_structure_set(&bytes).unwrap_err().to_string();
    let path = "(3006,0039)[1]/(3006,0040)[1]/ContourData (3006,0050): found \"x";
    assert!(refused.starts_with(path), "{refused}");
}
