//! Meshes: a file of each format is an item with its triangles, and is written again where it lay.

use super::{CONTEXT, read, refused};
use relief_annotation::{Geometry, MeshFormat, MeshSummary, TriangleMesh};
use relief_base::Point;
use relief_exchange::{Format, Imported, ReadContext, WriteContext};
use relief_volume::Grid;

const FORMATS: [(Format, MeshFormat); 4] = [
    (Format::Stl, MeshFormat::Stl),
    (Format::Ply, MeshFormat::Ply),
    (Format::Obj, MeshFormat::Obj),
    (Format::Glb, MeshFormat::Glb),
];

/// A corner of a box of 3 x 4 x 5 mm, all on one side of each axis: its volume is a sixth of the
/// box's.
fn tetrahedron() -> TriangleMesh {
    let at = |x, y, z| Point::new(10.0 + x, 20.0 + y, 30.0 + z);
    let vertices = vec![at(0.0, 0.0, 0.0), at(3.0, 0.0, 0.0), at(0.0, 4.0, 0.0), at(0.0, 0.0, 5.0)];
    TriangleMesh { vertices, triangles: vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]] }
}

fn summary(imported: &Imported) -> &MeshSummary {
    match imported.items[0].geometry.as_ref().unwrap() {
        Geometry::Mesh(mesh) => mesh,
        other => panic!("{other:?}"),
    }
}

#[test]
fn meshes_of_every_format_come_back_where_they_lay() {
    for (format, kind) in FORMATS {
        let file = relief_annotation::write_mesh(kind, &tetrahedron(), "horn").unwrap();
        let imported = read(format, &file).unwrap();
        assert_eq!(imported.warnings, [] as [&str; 0], "{format}");
        let found = summary(&imported);
        assert_eq!((found.vertices, found.triangles, imported.items[0].name.as_str()), (4, 4, "file"));
        assert!((found.volume_ml.unwrap() - 0.01).abs() < 1e-6, "{format}: {found:?}");
        let (content, media_type, bytes) = &imported.contents[0];
        assert_eq!((content, media_type.as_str()), (&found.content, "model/ply"));
        let context = WriteContext {
            contents: &|_| Some(bytes.clone()),
            grid: None,
            series: None,
            phase: None,
            warnings: &[],
        };
        let written = relief_exchange::write(format, &imported.items, &context).unwrap();
        let mesh = relief_annotation::read_mesh(kind, &written.bytes).unwrap().mesh;
        let [low, high] = mesh.span().map(|corner| corner.to_array());
        let is_near = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-4);
        assert!(
            is_near(low, [10.0, 20.0, 30.0]) && is_near(high, [13.0, 24.0, 35.0]),
            "{format}: {low:?} {high:?}"
        );
    }
}

#[test]
fn inverted_meshes_are_turned_and_distant_ones_give_a_warning() {
    let mut inside_out = tetrahedron();
    inside_out.triangles.iter_mut().for_each(|corners| corners.swap(0, 1));
    let file = relief_annotation::write_mesh(MeshFormat::Ply, &inside_out, "horn").unwrap();
    let grid = Grid::axis_aligned([4, 4, 4], [1.0; 3], [100.0, 0.0, 0.0]).unwrap();
    let context = ReadContext { grid: Some(&grid), ..CONTEXT };
    let imported = relief_exchange::read(Format::Ply, &file, &context).unwrap();
    assert!((summary(&imported).volume_ml.unwrap() - 0.01).abs() < 1e-6);
    assert_eq!(
        imported.warnings,
        [
            "the mesh lies outside of the volume; is it of the same scan?",
            "the triangles go round the wrong way: they are turned"
        ]
    );
}

#[test]
fn several_meshes_are_one_in_a_file_and_damage_is_refused() {
    let file = relief_annotation::write_mesh(MeshFormat::Ply, &tetrahedron(), "horn").unwrap();
    let [first, second] = [(); 2].map(|()| read(Format::Ply, &file).unwrap());
    let items = [first.items[0].clone(), second.items[0].clone()];
    let bytes = first.contents[0].2.clone();
    let context = WriteContext {
        contents: &|_| Some(bytes.clone()),
        grid: None,
        series: None,
        phase: None,
        warnings: &[],
    };
    let written = relief_exchange::write(Format::Ply, &items, &context).unwrap();
    assert_eq!(
        relief_annotation::read_mesh(MeshFormat::Ply, &written.bytes).unwrap().mesh.triangles.len(),
        8
    );
    assert!(written.left_out.iter().any(|lost| lost.what == "borders" && lost.items.len() == 2));
    let lost = WriteContext { contents: &|_| None, grid: None, series: None, phase: None, warnings: &[] };
    let refusal = relief_exchange::write(Format::Ply, &items, &lost).unwrap_err().to_string();
    assert!(refusal.contains("is not there"), "{refusal}");
    for (format, kind) in FORMATS {
        let whole = relief_annotation::write_mesh(kind, &tetrahedron(), "horn").unwrap();
        let said = refused(format, &whole[..whole.len() / 2]);
        assert!(said.starts_with(format.name()) && said.contains("expected"), "{format}: {said}");
    }
}
