//! Slices against SimpleITK and numpy: the same planes resampled by code that is not ours.
//!
//! Runs where `RELIEF_PEERS_PYTHON` names a Python that has both, and says aloud where it does not.

use std::path::Path;
use std::process::Command;

use glam::DVec3;
use relief_render::{RenderRequest, SceneFile};
use relief_volume::{Orbit, Volume};
use serde_json::json;

use super::renderer;
use super::twin::oblique_head;

/// Reads a volume and slices from JSON; writes HU rows as 64-bit floats, NaN outside the volume.
const SIMPLEITK: &str = r"
import json, sys, numpy as np, SimpleITK as sitk
work = json.load(open(sys.argv[1]))
voxels = np.fromfile(work['voxels'], '<i2').reshape(work['dims'][::-1]).astype(np.float64)
image = sitk.GetImageFromArray(voxels)
image.SetSpacing(work['spacing_mm'])
image.SetOrigin(work['origin_mm'])
image.SetDirection(work['direction'])
blends = {'mean': lambda v: np.average(v, axis=0, weights=[0.5] + [1] * (len(v) - 2) + [0.5]) if len(v) > 1 else v[0],
          'mip': lambda v: np.max(v, axis=0), 'minip': lambda v: np.min(v, axis=0)}
for job in work['slices']:
    values = [sitk.GetArrayFromImage(sitk.Resample(image, job['size_px'] + [1], sitk.Transform(), sitk.sitkLinear,
              (np.array(job['first_mm']) + offset * np.array(job['away'])).tolist(), job['pixel_mm'],
              np.array([job['right'], job['down'], job['away']]).T.flatten().tolist(), float('nan'), sitk.sitkFloat64))
              for offset in job['offsets_mm']]
    np.array(blends[job['blend']](np.stack(values)), '<f8').tofile(job['out'])
";

/// The peer's parameters for a slice, from the request's camera; samples from face to face of the
/// slab.
fn job(request: &RenderRequest, blend: &str, samples: u32, out: &Path) -> serde_json::Value {
    let camera = &request.camera;
    let away = (camera.look_at().xyz - camera.eye().xyz).normalize();
    let right = away.cross(camera.up().xyz).normalize();
    let down = away.cross(right);
    let [half_x, half_y] = camera.half_extent(request.size_px);
    let pixel = 2.0 * half_y / f64::from(request.size_px[1]);
    let first = camera.look_at().xyz - right * (half_x - pixel / 2.0) - down * (half_y - pixel / 2.0);
    let step = if samples > 1 { request.slab_mm / f64::from(samples - 1) } else { 0.0 };
    let offsets: Vec<f64> = (0..samples).map(|k| f64::from(k) * step - request.slab_mm / 2.0).collect();
    let list = |v: DVec3| v.to_array();
    json!({ "size_px": request.size_px, "first_mm": list(first), "pixel_mm": [pixel, pixel, 1.0],
            "right": list(right), "down": list(down), "away": list(away),
            "offsets_mm": offsets, "blend": blend, "out": out })
}

fn work(volume: &Volume, folder: &Path, slices: &[serde_json::Value]) -> serde_json::Value {
    let voxels = folder.join("voxels");
    std::fs::write(&voxels, bytemuck::cast_slice(volume.voxels_hu())).unwrap();
    let grid = volume.grid();
    json!({ "voxels": voxels, "dims": grid.dims(), "spacing_mm": grid.spacing_mm(), "slices": slices,
            "origin_mm": grid.origin().xyz.to_array(), "direction": grid.direction() })
}

/// Invariant: Slices are linear where the volume is, lie at the depth of the plane, and agree with
/// an independent resampler.
#[test]
fn slices_and_slabs_are_what_simpleitk_resamples() {
    let Ok(python) = std::env::var("RELIEF_PEERS_PYTHON") else {
        eprintln!("SKIPPED: slices against SimpleITK (RELIEF_PEERS_PYTHON is not set)");
        return;
    };
    let Some(mut renderer) = renderer("slices against SimpleITK") else { return };
    let volume = oblique_head();
    let folder = tempfile::tempdir().unwrap();
    let mut cases = Vec::new();
    for plane in [r#""axial""#, r#""coronal""#, r#"{"normal": [0.4, -0.8, 0.3], "up": [0.2, 0.1, 1]}"#] {
        for (blend, slab_mm, samples) in [("mean", 0, 1), ("mean", 12, 7), ("mip", 12, 7), ("minip", 12, 7)] {
            // The samples of 12 mm at 2 mm are 7. One grey is one HU.
            let scene = format!(
                r#"{{"mode": "slice", "size_px": [96, 64], "sample_distance_mm": 2,
                    "slice": {{"plane": {plane}, "offset_mm": 5.3, "slab_mm": {slab_mm}, "blend": "{blend}"}},
                    "transfer": {{"window": {{"center_hu": 20, "width_hu": 255}}}}}}"#
            );
            let scene = SceneFile::parse(scene.as_bytes()).unwrap();
            let request = scene.resolve(volume.grid(), &Orbit::default()).unwrap().request;
            let out = folder.path().join(format!("slice{}", cases.len()));
            cases.push((job(&request, blend, samples, &out), request, out, format!("{blend} of {plane}")));
        }
    }
    let jobs: Vec<_> = cases.iter().map(|(job, ..)| job.clone()).collect();
    let list = folder.path().join("work.json");
    std::fs::write(&list, work(&volume, folder.path(), &jobs).to_string()).unwrap();
    let output = Command::new(&python).arg("-c").arg(SIMPLEITK).arg(&list).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    for (_, request, out, what) in &cases {
        let peer = std::fs::read(out).unwrap();
        let peer = peer.chunks_exact(8).map(|bytes| f64::from_le_bytes(bytes.try_into().unwrap()));
        let frame = renderer.render(&volume, request).unwrap();
        let (mut compared, mut worst, mut sides) = (0, 0.0f64, 0);
        for (hu, (color, depth)) in peer.zip(frame.color_rgba.iter().zip(&frame.depth_mm)) {
            if hu.is_nan() {
                // A slab that is partly outside is NaN for the peer; only the plane must agree.
                sides += usize::from(request.slab_mm == 0.0 && depth.is_finite());
                continue;
            }
            sides += usize::from(!depth.is_finite());
            let grey = (hu - 20.0 + 127.5).clamp(0.0, 255.0);
            worst = worst.max((f64::from(color[0]) - grey).abs());
            compared += usize::from(grey > 0.0 && grey < 255.0);
        }
        println!(
            "{what}: {compared} greys, worst {worst:.2} HU, {sides} pixels on another side of the faces"
        );
        assert!(compared > 150, "{what}: {compared} greys say too little");
        // Rounding to a grey is half an HU; the sampler's weights are exact to 1/256 of up to 2000
        // HU a voxel.
        assert!(worst <= 4.0, "{what}: {worst} HU");
        assert!(sides <= 6, "{what}: {sides} pixels are inside for one and outside for the other");
    }
}
