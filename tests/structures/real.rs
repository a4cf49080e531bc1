//! Real series: bone of a chest and a vessel with contrast, grown, meshed and measured.

use relief_annotation::{Decimation, Grow, GrowError, GrowLimits, Smoothing, grow_region, surface_nets};
use relief_base::Point;
use relief_dicom::Strictness;
use relief_volume::Volume;

use super::common::any_series;
use super::peers::{python, same_as_simpleitk};

fn chest(what: &str) -> Option<Volume> {
    let folder = any_series(what, &["lidc-idri-0314", "totalseg-abdomen-j2k"])?;
    let found = relief_dicom::discover(&folder, Strictness::Lenient, &|_| ()).unwrap();
    Some(relief_dicom::load(found.select(None).unwrap(), Strictness::Lenient, &|_| ()).unwrap().volume)
}

/// The voxel in the middle of the largest cube of values in a range, looked for on a coarse raster:
/// a seed in the thick of it.
fn thick(volume: &Volume, [low, high]: [i16; 2], edge: usize) -> [usize; 3] {
    let [nx, ny, nz] = volume.grid().dims();
    let steps = |n: usize| (0..n.saturating_sub(edge)).step_by(3);
    let is_all = |i: usize, j: usize, k: usize| {
        let ranges = (k..k + edge)
            .flat_map(|c| (j..j + edge).flat_map(move |b| (i..i + edge).map(move |a| [a, b, c])));
        ranges.into_iter().all(|at| (low..=high).contains(&volume.hu(at)))
    };
    let found = steps(nz)
        .flat_map(|k| steps(ny).flat_map(move |j| steps(nx).map(move |i| [i, j, k])))
        .find(|[i, j, k]| is_all(*i, *j, *k));
    found.unwrap_or_else(|| panic!("no {edge} voxels of {low} to {high} HU")).map(|i| i + edge / 2)
}

#[test]
fn bone_of_a_chest_is_simpleitks_and_has_a_closed_surface() {
    let Some(volume) = chest("bone of a chest") else { return };
    let seed = thick(&volume, [300, 2000], 3);
    if let Some(python) = python("bone of a chest beside SimpleITK's", "SimpleITK") {
        let soft = thick(&volume, [0, 100], 8);
        let voxels = same_as_simpleitk(
            &python,
            &[(&volume, vec![seed], [200, 3000]), (&volume, vec![soft], [-50, 150])],
        );
        println!("bone and soft tissue, the same voxels: {voxels:?}");
    }
    let place =
        volume.grid().patient_from_voxel() * Point::new(seed[0] as f64, seed[1] as f64, seed[2] as f64);
    let what = |limits| Grow { seeds: vec![place], hu: [200, 3000], limits };
    let grown = grow_region(&volume, &what(GrowLimits::default()), &|_| true).unwrap();
    let mesh = surface_nets(&grown.mask).unwrap();
    let smooth = mesh.smoothed(Smoothing::default()).unwrap();
    let light = smooth.decimated(Decimation::to(smooth.triangles.len() / 10)).unwrap();
    println!(
        "bone {:.1} ml, {} triangles, smooth {:?}, light {} {:?}",
        grown.volume_ml,
        mesh.triangles.len(),
        smooth.measures(),
        light.triangles.len(),
        light.measures()
    );
    for (mesh, share) in [(&mesh, 0.12), (&smooth, 0.12), (&light, 0.15)] {
        let measures = mesh.measures();
        assert!(measures.is_manifold, "{measures:?}");
        // Trabecular bone is nearly all surface: corners between voxels take a part of it away.
        assert!((measures.volume_ml.unwrap() / grown.volume_ml - 1.0).abs() < share, "{measures:?}");
    }
    // Half of it allowed: it leaks, and says how much it had reached.
    let half = GrowLimits { max_ml: Some(grown.volume_ml / 2.0), ..GrowLimits::default() };
    assert!(matches!(grow_region(&volume, &what(half), &|_| true), Err(GrowError::Leaked { .. })));
    let near = GrowLimits { max_radius_mm: Some(30.0), ..GrowLimits::default() };
    let near = grow_region(&volume, &what(near), &|_| true).unwrap();
    let farthest = super::shapes::indices(volume.grid())
        .filter(|at| near.mask.contains(*at))
        .map(|at| {
            (volume.grid().patient_from_voxel() * Point::new(at[0] as f64, at[1] as f64, at[2] as f64))
                .distance(place)
        })
        .fold(0.0, f64::max);
    assert!(farthest <= 30.0 && farthest > 20.0, "{farthest}");
}
