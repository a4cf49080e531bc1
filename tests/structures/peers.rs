//! Our regions and meshes in other tools, and theirs in ours: SimpleITK, VTK and trimesh.

use std::path::Path;
use std::process::Command;

use glam::DVec3;

use super::shapes::{grid, indices, mask, noise};
use relief_annotation::grow_region;
use relief_annotation::{
    Grow, GrowLimits, MeshFormat, Smoothing, TriangleMesh, read_mesh, surface_nets, write_mesh,
};
use relief_base::Point;
use relief_volume::{Mask, Segment, SegmentIndices, Volume};

/// The peers' Python, or `None` with a message. It must have `module`.
pub(crate) fn python(what: &str, module: &str) -> Option<String> {
    let Ok(python) = std::env::var("RELIEF_PEERS_PYTHON") else {
        eprintln!("SKIPPED: {what} (RELIEF_PEERS_PYTHON is not set)");
        return None;
    };
    let has = Command::new(&python).args(["-c", &format!("import {module}")]).output().unwrap();
    if !has.status.success() {
        eprintln!("SKIPPED: {what} (the peers have no {module})");
        return None;
    }
    Some(python)
}

/// Runs a script with a folder as its argument; returns its JSON output.
pub(crate) fn run(python: &str, script: &str, folder: &Path) -> serde_json::Value {
    let output = Command::new(python).arg("-c").arg(script).arg(folder).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).unwrap()
}

/// A lump that is like itself under no turn and no mirror, away from the origin.
fn lump() -> Mask {
    mask(&grid(60.0, [0.9, 1.1, 1.4], [0.3, -0.2, 0.5], false), |p| {
        let arm = |to: DVec3, radius: f64| {
            let along = (p.dot(to) / to.length_squared()).clamp(0.0, 1.0);
            p.distance(to * along) <= radius
        };
        arm(DVec3::X * 22.0, 6.0) || arm(DVec3::Y * 16.0, 5.0) || arm(DVec3::Z * 12.0, 4.0)
    })
}

fn moved(mesh: &TriangleMesh) -> TriangleMesh {
    let vertices =
        mesh.vertices.iter().map(|v| Point::from_xyz(v.xyz + DVec3::new(100.0, -50.0, 30.0))).collect();
    TriangleMesh { vertices, triangles: mesh.triangles.clone() }
}

fn near(found: &serde_json::Value, expected: f64, share: f64, what: &str) {
    let found = found.as_f64().unwrap();
    assert!((found - expected).abs() <= share * expected.abs().max(1.0), "{what}: {found} for {expected}");
}

const VTK: &str = r"
import json, os, sys, vtk
folder = sys.argv[1]
out = {}
readers = {'ply': vtk.vtkPLYReader, 'stl': vtk.vtkSTLReader, 'obj': vtk.vtkOBJReader}
mesh = None
for name, reader in readers.items():
    r = reader(); r.SetFileName(os.path.join(folder, 'ours.' + name)); r.Update()
    m = vtk.vtkMassProperties(); m.SetInputConnection(r.GetOutputPort()); m.Update()
    e = vtk.vtkFeatureEdges(); e.SetInputConnection(r.GetOutputPort()); e.FeatureEdgesOff(); e.ManifoldEdgesOff(); e.Update()
    out[name] = {'volume': m.GetVolume(), 'area': m.GetSurfaceArea(), 'bounds': r.GetOutput().GetBounds(),
                 'bad_edges': e.GetOutput().GetNumberOfCells(), 'triangles': r.GetOutput().GetNumberOfPolys()}
    mesh = r.GetOutput() if name == 'ply' else mesh
for name, writer, binary in [('b.ply', vtk.vtkPLYWriter, 1), ('a.ply', vtk.vtkPLYWriter, 0),
                             ('b.stl', vtk.vtkSTLWriter, 1), ('a.stl', vtk.vtkSTLWriter, 0)]:
    w = writer(); w.SetInputData(mesh); w.SetFileName(os.path.join(folder, name))
    w.SetFileTypeToBinary() if binary else w.SetFileTypeToASCII()
    w.Write()
w = vtk.vtkOBJWriter(); w.SetInputData(mesh); w.SetFileName(os.path.join(folder, 'a.obj')); w.Write()
print(json.dumps(out))
";

#[test]
fn vtk_reads_our_files_and_we_read_vtks() {
    let Some(python) = python("mesh files beside VTK's", "vtk") else { return };
    let mesh = moved(&surface_nets(&lump()).unwrap().smoothed(Smoothing::default()).unwrap());
    let folder = tempfile::tempdir().unwrap();
    for format in [MeshFormat::Ply, MeshFormat::Stl, MeshFormat::Obj] {
        let path = folder.path().join(format!("ours.{}", format.name()));
        std::fs::write(path, write_mesh(format, &mesh, "lump").unwrap()).unwrap();
    }
    let found = run(&python, VTK, folder.path());
    let own = mesh.measures();
    let [low, high] = mesh.span();
    for name in ["ply", "stl", "obj"] {
        let found = &found[name];
        near(&found["volume"], own.volume_ml.unwrap() * 1000.0, 1e-4, name);
        near(&found["area"], own.area_mm2, 1e-4, name);
        assert_eq!(found["bad_edges"], 0, "{name}: edges without two triangles");
        assert_eq!(found["triangles"], mesh.triangles.len());
        for (n, expected) in [low.x, high.x, low.y, high.y, low.z, high.z].into_iter().enumerate() {
            near(&found["bounds"][n], expected, 1e-5, name);
        }
    }
    for name in ["b.ply", "a.ply", "b.stl", "a.stl", "a.obj"] {
        let path = folder.path().join(name);
        let format = MeshFormat::of(&path).unwrap();
        let theirs = read_mesh(format, &std::fs::read(&path).unwrap()).unwrap();
        let measures = theirs.mesh.measures();
        assert!(measures.is_manifold, "{name}: {measures:?}");
        // ASCII of VTK has six digits.
        assert!(
            (measures.volume_ml.unwrap() / own.volume_ml.unwrap() - 1.0).abs() < 1e-3,
            "{name}: {measures:?}"
        );
        assert!((theirs.mesh.span()[0] - low).length() < 2e-3, "{name}: not mirrored, not moved");
        assert!(
            theirs.warnings.iter().any(|text| text.contains("SPACE=LPS")),
            "{name}: {:?}",
            theirs.warnings
        );
    }
}

const TRIMESH: &str = r"
import json, os, sys, trimesh
folder = sys.argv[1]
out = {}
for name in ('ply', 'stl', 'obj', 'glb'):
    m = trimesh.load(os.path.join(folder, 'ours.' + name), force='mesh')
    out[name] = {'watertight': bool(m.is_watertight), 'winding': bool(m.is_winding_consistent), 'volume': float(m.volume),
                 'area': float(m.area), 'bounds': m.bounds.tolist(), 'euler': int(m.euler_number)}
    m.export(os.path.join(folder, 'theirs.' + name))
print(json.dumps(out))
";

#[test]
fn trimesh_reads_our_files_and_we_read_trimeshs() {
    let Some(python) = python("mesh files beside trimesh's", "trimesh") else { return };
    let mesh = moved(&surface_nets(&lump()).unwrap().smoothed(Smoothing::default()).unwrap());
    let folder = tempfile::tempdir().unwrap();
    for format in MeshFormat::ALL {
        let path = folder.path().join(format!("ours.{}", format.name()));
        std::fs::write(path, write_mesh(format, &mesh, "lump").unwrap()).unwrap();
    }
    let found = run(&python, TRIMESH, folder.path());
    let own = mesh.measures();
    let [low, high] = mesh.span();
    for format in MeshFormat::ALL {
        let (name, found) = (format.name(), &found[format.name()]);
        assert_eq!((&found["watertight"], &found["winding"]), (&true.into(), &true.into()), "{name}");
        assert_eq!(found["euler"], own.euler.unwrap(), "{name}");
        // glTF: metres; X to the left, Y up, Z to the front.
        let is_gltf = format == MeshFormat::Glb;
        let unit = if is_gltf { 1000.0 } else { 1.0 };
        near(
            &found["volume"],
            own.volume_ml.unwrap() * 1000.0 / f64::powi(unit, 3),
            1e-4 / f64::powi(unit, 3),
            name,
        );
        let expected = if is_gltf { [low.x / 1e3, low.z / 1e3, -high.y / 1e3] } else { low.to_array() };
        for (axis, expected) in expected.into_iter().enumerate() {
            near(&found["bounds"][0][axis], expected, 1e-5, name);
        }
        let theirs = std::fs::read(folder.path().join(format!("theirs.{name}"))).unwrap();
        let theirs = read_mesh(format, &theirs).unwrap().mesh;
        assert!(theirs.measures().is_manifold, "{name}");
        assert!(
            (theirs.span()[0] - low).length() < 1e-3 && (theirs.span()[1] - high).length() < 1e-3,
            "{name}"
        );
    }
}

const SIMPLEITK: &str = r"
import json, os, sys, hashlib, numpy as np, SimpleITK as sitk
folder = sys.argv[1]
out = []
for facts in json.load(open(os.path.join(folder, 'facts.json'))):
    nx, ny, nz = facts['dims']
    image = sitk.GetImageFromArray(np.fromfile(os.path.join(folder, facts['raw']), dtype='<i2').reshape(nz, ny, nx))
    mask = sitk.GetArrayFromImage(sitk.ConnectedThreshold(image, facts['seeds'], facts['hu'][0], facts['hu'][1], 1))
    out.append({'voxels': int(mask.sum()), 'sha256': hashlib.sha256(mask.tobytes()).hexdigest()})
print(json.dumps(out))
";

/// A volume, seeds and the values that belong.
pub(crate) type Case<'a> = (&'a Volume, Vec<[usize; 3]>, [i16; 2]);

/// Regions without limits, and SimpleITK's of the same seeds, as numbers of voxels; they must be
/// the same voxels.
pub(crate) fn same_as_simpleitk(python: &str, cases: &[Case<'_>]) -> Vec<u64> {
    let folder = tempfile::tempdir().unwrap();
    let mut facts = Vec::new();
    for (n, (volume, seeds, hu)) in cases.iter().enumerate() {
        let raw = format!("{n}.raw");
        std::fs::write(folder.path().join(&raw), bytemuck::cast_slice(volume.voxels_hu())).unwrap();
        let dims = volume.grid().dims();
        facts.push(serde_json::json!({ "raw": raw, "dims": dims, "seeds": seeds, "hu": hu }));
    }
    std::fs::write(folder.path().join("facts.json"), serde_json::to_vec(&facts).unwrap()).unwrap();
    let found = run(python, SIMPLEITK, folder.path());
    let mut voxels = Vec::new();
    for ((volume, seeds, hu), found) in cases.iter().zip(found.as_array().unwrap()) {
        let place = |seed: &[usize; 3]| {
            volume.grid().patient_from_voxel() * Point::new(seed[0] as f64, seed[1] as f64, seed[2] as f64)
        };
        let what = Grow { seeds: seeds.iter().map(place).collect(), hu: *hu, limits: GrowLimits::default() };
        let grown = grow_region(volume, &what, &|_| true).unwrap();
        assert_eq!(found["voxels"], grown.voxels, "{seeds:?} {hu:?}");
        let map = grown.mask.to_labels(Segment::new(1, None, None));
        let SegmentIndices::Bytes(places) = map.places() else { panic!("one segment") };
        let digest: String = sha2::Digest::finalize(<sha2::Sha256 as sha2::Digest>::new_with_prefix(places))
            .iter()
            .map(|byte: &u8| format!("{byte:02x}"))
            .collect();
        assert_eq!(found["sha256"], digest, "{seeds:?} {hu:?}");
        voxels.push(grown.voxels);
    }
    voxels
}

#[test]
fn regions_are_voxel_by_voxel_those_of_simpleitk() {
    let Some(python) = python("region growing beside SimpleITK's", "SimpleITK") else { return };
    let noisy = |percent, seed| {
        let mask = noise([90, 70, 50], percent, seed);
        let values = indices(mask.grid()).map(|index| 100 * i16::from(mask.contains(index))).collect();
        Volume::new(mask.grid().clone(), values).unwrap()
    };
    let [winding, dense] = [noisy(33, 5), noisy(60, 6)];
    let those = |volume: &Volume, hu: i16, step: usize| {
        indices(volume.grid()).filter(|at| volume.hu(*at) == hu).step_by(step).collect::<Vec<_>>()
    };
    let cases = [
        (&winding, those(&winding, 100, 997), [50, 150]),
        (&dense, those(&dense, 100, 1_000_000), [100, 100]),
        (&dense, those(&dense, 0, 4001), [-5, 5]),
    ];
    let voxels = same_as_simpleitk(&python, &cases);
    println!("the same voxels: {voxels:?}");
    assert!(voxels[0] > 10_000 && voxels[1] > 180_000, "{voxels:?}");
}
