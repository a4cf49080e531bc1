//! Tables of datasets: every picture with its depth and camera, as those read them who learn from
//! pictures.
//!
//! | file | of | for |
//! |---|---|---|
//! | `dataset.jsonl` | all series | a line a picture: files, `K`, pose (OpenCV) |
//! | `SERIES/transforms.json` | a series | NeRF's readers: poses with OpenGL's axes |
//! | `SERIES/sparse/0/*.txt` | a series | COLMAP's text model: cameras, images, points |
//!
//! They are made of the `camera.json` beside the pictures, whenever a report is written. World:
//! patient LPS, mm.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use glam::{DMat4, DVec3};
use serde_json::{Value, json};

use super::pose::ViewCamera;
use super::product::Product;
use super::record::Record;
use super::sink::Sink;

/// Largest camera file that is read, bytes.
const LARGEST: u64 = 1 << 20;

/// A picture of a dataset.
struct Shot<'a> {
    record: &'a Record,
    camera: ViewCamera,
}

/// Writes the tables of all series that have cameras; nothing where none has.
///
/// # Errors
/// When a file cannot be written.
pub(super) fn write_tables<'a>(records: impl Iterator<Item = &'a Record>, out: &Sink) -> std::io::Result<()> {
    let mut series: BTreeMap<&str, Vec<Shot<'a>>> = BTreeMap::new();
    for record in records {
        if let Some(camera) = read(record, out) {
            series.entry(&record.series).or_default().push(Shot { record, camera });
        }
    }
    if series.is_empty() {
        return Ok(());
    }
    let mut lines = String::new();
    for (name, shots) in &series {
        out.put(&format!("{name}/transforms.json"), transforms(shots).to_string())?;
        for (file, text) in colmap(shots) {
            out.put(&format!("{name}/sparse/0/{file}"), text)?;
        }
        shots.iter().for_each(|shot| {
            let _ = writeln!(lines, "{}", line(shot));
        });
    }
    out.put("dataset.jsonl", lines)
}

fn read(record: &Record, out: &Sink) -> Option<ViewCamera> {
    let name = format!("{}/{}", record.series, record.output(Product::Camera)?);
    serde_json::from_slice(&out.read(&name, LARGEST).ok()??).ok()
}

fn line(Shot { record, camera }: &Shot<'_>) -> Value {
    let file = |product| record.output(product).map(|file| format!("{}/{file}", record.series));
    json!({
        "series": record.series,
        "view": record.view,
        "color": file(Product::Color),
        "depth_png": file(Product::DepthPng),
        "depth_exr": file(Product::Depth),
        "labels": file(Product::Labels),
        "structures": record.structures,
        "size_px": camera.size_px,
        "K": camera.intrinsics,
        "camera_from_patient": camera.camera_from_patient,
        "near_mm": camera.near_mm,
        "far_mm": camera.far_mm,
        "depth_png_unit_mm": camera.depth_png_unit_mm,
    })
}

/// As instant-ngp and nerfstudio read it: camera to world, axes as OpenGL has them (x right, y up,
/// looking along -z).
fn transforms(shots: &[Shot<'_>]) -> Value {
    let to_opengl = DMat4::from_scale(DVec3::new(1.0, -1.0, -1.0));
    let frame = |Shot { record, camera }: &Shot<'_>| {
        let [fx, fy, cx, cy] = camera.pinhole();
        let pose = camera.pose().inverse() * to_opengl;
        json!({
            "file_path": record.output(Product::Color),
            "depth_file_path": record.output(Product::DepthPng),
            "w": camera.size_px[0], "h": camera.size_px[1],
            "fl_x": fx, "fl_y": fy, "cx": cx, "cy": cy,
            "transform_matrix": pose.transpose().to_cols_array_2d(),
        })
    };
    let unit = shots.first().map_or(0.0, |shot| shot.camera.depth_png_unit_mm);
    json!({
        "camera_model": "PINHOLE",
        "world": "patient LPS, mm",
        "depth_unit_scale_factor": unit,
        "frames": shots.iter().map(frame).collect::<Vec<_>>(),
    })
}

/// The three files of a text model. Each place of the surface is seen in the one picture that it
/// was taken from.
fn colmap(shots: &[Shot<'_>]) -> [(&'static str, String); 3] {
    let mut cameras = String::from("# CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[fx, fy, cx, cy]\n");
    let mut images = String::from(
        "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n# POINTS2D[] as (X, Y, POINT3D_ID)\n",
    );
    let mut points =
        String::from("# POINT3D_ID, X, Y, Z, R, G, B, ERROR, TRACK[] as (IMAGE_ID, POINT2D_IDX)\n");
    let (mut known, mut point) = (Vec::new(), 0u64);
    for (image, Shot { record, camera }) in (1u64..).zip(shots) {
        let intrinsics = (camera.size_px, camera.pinhole());
        let id = known.iter().position(|other| *other == intrinsics).unwrap_or_else(|| {
            known.push(intrinsics);
            let ([width, height], [fx, fy, cx, cy]) = intrinsics;
            let _ = writeln!(cameras, "{} PINHOLE {width} {height} {fx} {fy} {cx} {cy}", known.len());
            known.len() - 1
        }) + 1;
        let ([w, x, y, z], [tx, ty, tz]) = camera.rotation_and_translation();
        let name = record.output(Product::Color).unwrap_or_default();
        let _ = writeln!(images, "{image} {w} {x} {y} {z} {tx} {ty} {tz} {id} {name}");
        let mut seen = Vec::new();
        for (index, [column, row, x, y, z, r, g, b]) in camera.surface.iter().enumerate() {
            point += 1;
            let _ = writeln!(points, "{point} {x} {y} {z} {r} {g} {b} 0 {image} {index}");
            seen.push(format!("{} {} {point}", column + 0.5, row + 0.5));
        }
        let _ = writeln!(images, "{}", seen.join(" "));
    }
    [("cameras.txt", cameras), ("images.txt", images), ("points3D.txt", points)]
}
