//! Label maps and volumes in files: NIfTI, NRRD and DICOM segmentations of other programs against
//! facts that were computed independently, against SimpleITK, and against damage.

#![expect(clippy::unwrap_used, reason = "tests fail and speak aloud")]

use crate::common;
mod characters;
mod damage;
mod peer;
mod real;
mod segmentations;
mod written;

use std::path::{Path, PathBuf};

use relief_volume::LabelMap;

/// A file of these bytes in a folder of its own.
fn file_of(name: &str, bytes: &[u8]) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    (folder, path)
}

/// Number of voxels, volume in ml, and centroid in patient LPS of each segment that has voxels.
fn measured(map: &LabelMap) -> Vec<(u16, u64, f64, [f64; 3])> {
    let [nx, ny, nz] = map.grid().dims();
    let mut sums = vec![(0u64, glam::DVec3::ZERO); map.segments().len() + 1];
    for (k, j, i) in (0..nz).flat_map(|k| (0..ny).flat_map(move |j| (0..nx).map(move |i| (k, j, i)))) {
        let sum = &mut sums[map.places().at((k * ny + j) * nx + i)];
        sum.0 += 1;
        sum.1 += glam::DVec3::new(i as f64, j as f64, k as f64);
    }
    let segment = |(segment, (count, sum)): (&relief_volume::Segment, &(u64, glam::DVec3))| {
        let center = map.grid().patient_from_voxel().affine.transform_point3(*sum / *count as f64);
        (segment.label, *count, *count as f64 * map.voxel_mm3() / 1000.0, center.to_array())
    };
    map.segments().iter().zip(&sums[1..]).filter(|(_, (count, _))| *count > 0).map(segment).collect()
}

fn near(a: [f64; 3], b: &[f64], most: f64) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= most)
}

/// A NIfTI-1 file of bytes in RAS, 2 mm voxels, whose voxels are these.
fn nifti(dims: [i16; 3], voxels: &[u8]) -> Vec<u8> {
    let mut bytes = vec![0u8; 352];
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    put(0, &348i32.to_le_bytes());
    let all = [3, dims[0], dims[1], dims[2], 1, 1, 1, 1];
    all.iter().enumerate().for_each(|(n, dim)| put(40 + 2 * n, &dim.to_le_bytes()));
    put(70, &2i16.to_le_bytes());
    put(72, &8i16.to_le_bytes());
    put(108, &352f32.to_le_bytes());
    put(123, &[2]);
    put(254, &1i16.to_le_bytes());
    for (row, at) in [280, 296, 312].into_iter().enumerate() {
        put(at + 4 * row, &2f32.to_le_bytes());
        put(at + 12, &[10f32, 20.0, 30.0][row].to_le_bytes());
    }
    put(344, b"n+1\0");
    bytes.extend_from_slice(voxels);
    bytes
}

/// A NRRD file with this header, fields beside the usual ones, and these bytes behind it.
fn nrrd(fields: &str, voxels: &[u8]) -> Vec<u8> {
    let mut bytes = format!(
        "NRRD0004\n# made for a test\n{fields}space: left-posterior-superior\nspace origin: (1,2,3)\n\n"
    )
    .into_bytes();
    bytes.extend_from_slice(voxels);
    bytes
}

const NRRD_FIELDS: &str =
    "type: uchar\ndimension: 3\nsizes: 3 2 1\nspace directions: (2,0,0) (0,2,0) (0,0,2)\nencoding: raw\n";

fn gzipped(bytes: &[u8]) -> Vec<u8> {
    use std::io::Write;
    let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

/// Reads labels of bytes through a file.
fn labels_of(name: &str, bytes: &[u8]) -> Result<LabelMap, String> {
    let (_folder, path) = file_of(name, bytes);
    read(&path)
}

fn read(path: &Path) -> Result<LabelMap, String> {
    relief_dicom::read_labels(path).map(|found| found.map).map_err(|error| error.to_string())
}
