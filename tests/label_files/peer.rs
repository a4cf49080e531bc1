//! Files that SimpleITK writes: every type of number, oblique axes, byte orders and compressions.

use std::process::Command;

use super::near;

/// Writes a turned grid of labels and of HU in every format and type; prints where SimpleITK has a
/// few voxels, in LPS.
const SIMPLEITK: &str = r"
import json, os, sys, numpy as np, SimpleITK as sitk
folder = sys.argv[1]
rng = np.random.default_rng(3)
labels = rng.integers(0, 100, (5, 6, 7))
out = []
angle = 0.4
turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
tilt = np.array([[1, 0, 0], [0, np.cos(0.3), -np.sin(0.3)], [0, np.sin(0.3), np.cos(0.3)]])
for mirror in (1, -1):
    direction = turn @ tilt @ np.diag([1, 1, mirror])
    for name, kind in [('u8', np.uint8), ('i8', np.int8), ('i16', np.int16), ('u16', np.uint16), ('i32', np.int32),
                       ('u32', np.uint32), ('f32', np.float32), ('f64', np.float64)]:
        image = sitk.GetImageFromArray(labels.astype(kind))
        image.SetSpacing([0.7, 1.3, 2.5]); image.SetOrigin([-12.5, 40.25, 7.75])
        image.SetDirection(direction.flatten().tolist())
        for ending, packed in [('nii', False), ('nii.gz', True), ('nrrd', False), ('nrrd', True)]:
            path = os.path.join(folder, f'{name}_{mirror}_{packed}.{ending}')
            sitk.WriteImage(image, path, packed)
            out.append({'path': path, 'values': labels.flatten().tolist(),
                        'corners': [image.TransformIndexToPhysicalPoint(i) for i in [(0, 0, 0), (6, 0, 0), (0, 5, 0), (0, 0, 4)]]})
print(json.dumps(out))
";

/// Invariant: Label maps of other programs lie where those programs put them; damaged files, and
/// files that claim too much, end in an error.
#[test]
fn label_maps_written_by_simpleitk_keep_their_position() {
    let Ok(python) = std::env::var("RELIEF_PEERS_PYTHON") else {
        eprintln!("SKIPPED: files of SimpleITK (RELIEF_PEERS_PYTHON is not set)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let output = Command::new(python).arg("-c").arg(SIMPLEITK).arg(folder.path()).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let files: Vec<serde_json::Value> = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(files.len(), 64);
    for file in &files {
        let path = std::path::Path::new(file["path"].as_str().unwrap());
        let map = relief_dicom::read_labels(path).unwrap_or_else(|error| panic!("{path:?}: {error}")).map;
        let volume = relief_dicom::read_volume(path).unwrap().volume;
        assert_eq!(map.grid(), volume.grid());
        let values: Vec<i16> =
            file["values"].as_array().unwrap().iter().map(|v| v.as_i64().unwrap() as i16).collect();
        assert_eq!(volume.voxels_hu(), values, "{path:?}");
        let label = |at: usize| map.places().at(at).checked_sub(1).map_or(0, |n| map.segments()[n].label);
        assert!(values.iter().enumerate().all(|(at, &v)| label(at) == v as u16), "{path:?}");
        for (corner, at) in
            file["corners"].as_array().unwrap().iter().zip([[0; 3], [6, 0, 0], [0, 5, 0], [0, 0, 4]])
        {
            let at = at.map(f64::from);
            let found = map.grid().patient_from_voxel().affine.transform_point3(at.into()).to_array();
            let expected: Vec<f64> = corner.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
            // NIfTI keeps 32 bits.
            assert!(near(found, &expected, 1e-4), "{path:?}: {found:?} for {expected:?}");
        }
    }
    println!("{} files of SimpleITK", files.len());
}
