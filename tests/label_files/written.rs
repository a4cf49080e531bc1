//! Label maps that Relief writes as NIfTI, read by nibabel, by SimpleITK and by Relief.

use std::process::Command;

use glam::{DMat3, DVec3};

use relief_base::Transform;
use relief_volume::{Grid, LabelMap, Segment};
use serde_json::Value;

use super::common::numbers;
use super::{file_of, near, read};

/// Nothing in it lies where its mirror image would.
fn map(axes: DMat3, label: u16) -> LabelMap {
    let affine =
        Transform::from_axes(axes.x_axis, axes.y_axis, axes.z_axis, DVec3::new(-31.25, 17.5, -205.125));
    let grid = Grid::new([4, 3, 2], affine).unwrap();
    let mut labels = [0; 24];
    (labels[1], labels[7], labels[8], labels[23]) = (1, 2, label, label);
    let named = Segment::new(2, Some("Leber <links> & ]]> mehr"), Some([0.5, 0.25, 1.0]));
    LabelMap::new(grid, &labels, vec![named]).unwrap()
}

/// Turned axes of three lengths, the third one turned about as well, and axes that are not at right
/// angles.
fn grids() -> [DMat3; 3] {
    let turn = DMat3::from_rotation_z(2.4) * DMat3::from_rotation_x(-0.3);
    let [x, y, z] = [turn.x_axis * 0.7, turn.y_axis * 0.9, turn.z_axis * 1.3];
    [[x, y, z], [x, y, -z], [x, y, z + 0.4 * x]].map(|[x, y, z]| DMat3::from_cols(x, y, z))
}

const PEERS: &str = r"
import json, sys, numpy as np, nibabel, SimpleITK as sitk
image = nibabel.load(sys.argv[1])
found = {'values': np.asarray(image.dataobj).flatten(order='F').tolist(), 'type': str(image.get_data_dtype()),
         'sform': image.get_sform(coded=True)[0].flatten().tolist(), 'codes': [int(image.header['qform_code']), int(image.header['sform_code'])],
         'units': image.header.get_xyzt_units()[0], 'extensions': [e.get_code() for e in image.header.extensions]}
if image.header['qform_code']:
    found['qform'] = image.get_qform().flatten().tolist()
    itk = sitk.ReadImage(sys.argv[1])
    found['itk'] = sitk.GetArrayFromImage(itk).flatten().tolist()
    found['lps'] = [itk.TransformIndexToPhysicalPoint(i) for i in [(0, 0, 0), (3, 0, 0), (0, 2, 0), (0, 0, 1)]]
print(json.dumps(found))
";

#[test]
fn nibabel_and_simpleitk_read_what_is_written_where_it_lies() {
    let python = std::env::var("RELIEF_PEERS_PYTHON");
    if python.is_err() {
        eprintln!("SKIPPED: label maps read by nibabel and SimpleITK (RELIEF_PEERS_PYTHON is not set)");
    }
    for (axes, label) in grids().into_iter().flat_map(|axes| [(axes, 9), (axes, 700)]) {
        let map = map(axes, label);
        let (_folder, path) = file_of("labels.nii.gz", &relief_dicom::write_nifti_labels(&map).unwrap());
        let back = read(&path).unwrap();
        assert_eq!(back.places(), map.places());
        let named = back.segments().iter().find(|segment| segment.label == 2).unwrap();
        assert_eq!(
            (named.name.as_deref(), named.rgb),
            (Some("Leber <links> & ]] > mehr"), Some([0.5, 0.25, 1.0]))
        );
        let affine = map.grid().patient_from_voxel().affine;
        let off =
            back.grid().patient_from_voxel().affine.to_cols_array().into_iter().zip(affine.to_cols_array());
        assert!(off.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max) < 1e-5, "NIfTI keeps 32 bits");
        let Ok(python) = &python else { continue };
        let output = Command::new(python).arg("-c").arg(PEERS).arg(&path).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let found: Value = serde_json::from_slice(&output.stdout).unwrap();
        let value = |at: usize| map.places().at(at).checked_sub(1).map_or(0, |n| map.segments()[n].label);
        let values: Vec<f64> = (0..24).map(|at| f64::from(value(at))).collect();
        assert_eq!(numbers(&found["values"]), values);
        assert_eq!(found["type"], if label > 255 { "uint16" } else { "uint8" });
        assert_eq!((&found["units"], &found["extensions"]), (&"mm".into(), &serde_json::json!([30])));
        // RAS: rows of the affine map, the first two of them mirrored.
        let rows: Vec<f64> = (0..3)
            .flat_map(|row| {
                let sign = if row < 2 { -1.0 } else { 1.0 };
                axes.row(row).to_array().into_iter().chain([affine.translation[row]]).map(move |mm| sign * mm)
            })
            .chain([0.0, 0.0, 0.0, 1.0])
            .collect();
        let same = |found: &Value| numbers(found).iter().zip(&rows).all(|(a, b)| (a - b).abs() < 1e-4);
        assert!(same(&found["sform"]), "{found:#}");
        let is_straight = axes.x_axis.dot(axes.z_axis).abs() < 1e-9;
        assert_eq!(found["codes"], serde_json::json!([i32::from(is_straight), 1]));
        if is_straight {
            assert!(same(&found["qform"]), "{found:#}");
            assert_eq!(numbers(&found["itk"]), values);
            for (corner, at) in
                found["lps"].as_array().unwrap().iter().zip([[0; 3], [3, 0, 0], [0, 2, 0], [0, 0, 1]])
            {
                let at = affine.transform_point3(at.map(f64::from).into()).to_array();
                assert!(near(at, &numbers(corner), 1e-4), "{corner} for {at:?}");
            }
        }
    }
}
