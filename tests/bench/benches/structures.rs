//! Times of structures: a region grown from a seed, its mask's surface, smoothed and decimated; one
//! JSON object.
//!
//! cargo bench -p relief-bench --bench structures -- [--size N] [--repeat N] [--input head|gyroid]
//! [--keep FOLDER]
//!
//! Two volumes of N voxels along each side (512 by default; the head has fewer slices): the head
//! phantom's bone, and a ball of winding sheets (a gyroid), which is all one region and nearly all
//! surface. The median of the repeats counts, three by default. With `--keep` the volumes and seeds
//! are written for scripts/peers/structures.py, which scripts/compare-structures calls.
#![expect(clippy::unwrap_used, reason = "volumes are made here: what fails is the benchmark")]
#![expect(clippy::print_stdout, clippy::print_stderr, reason = "a benchmark says what it found")]

use std::path::Path;
use std::time::Instant;

use serde_json::json;
use sha2::{Digest, Sha256};

use relief_annotation::grow_region;
use relief_annotation::{Decimation, Grow, GrowLimits, Smoothing, surface_nets};
use relief_base::Point;
use relief_volume::{Grid, PhantomKind, PhantomRecipe, Segment, SegmentIndices, Volume};

/// Triangles of the largest mesh that is decimated.
const MOST_DECIMATED: usize = 4_000_000;

/// Makes an input with this many voxels across.
type Maker = fn(usize) -> Input;

struct Input {
    name: &'static str,
    volume: Volume,
    seed: [usize; 3],
    hu: [i16; 2],
}

fn main() {
    let words: Vec<String> = std::env::args().collect();
    let value = |key: &str| words.iter().position(|word| word == key).and_then(|at| words.get(at + 1));
    let size = value("--size").map_or(512, |size| size.parse().unwrap());
    let repeat = value("--repeat").map_or(3, |repeat| repeat.parse().unwrap());
    let makers: [(&str, Maker); 2] = [("head", head), ("gyroid", gyroid)];
    let wanted = makers.iter().filter(|(name, _)| value("--input").is_none_or(|wanted| wanted == name));
    let reports: Vec<_> = wanted
        .map(|(name, make)| {
            eprintln!("{name}: making the volume");
            let input = make(size);
            if let Some(folder) = value("--keep") {
                keep(Path::new(folder), &input);
            }
            measure(&input, repeat)
        })
        .collect();
    println!(
        "{}",
        serde_json::to_string_pretty(&json!({ "threads": rayon::current_num_threads(), "inputs": reports }))
            .unwrap()
    );
}

/// Bone of the head phantom.
fn head(size: usize) -> Input {
    let volume = PhantomRecipe::new(PhantomKind::Head).with_size(size).unwrap().make().volume;
    let hu = [300, 3000];
    // The first bone from the middle upwards is the top of the skull.
    let [nx, ny, nz] = volume.grid().dims();
    let k = (nz / 2..nz).find(|k| hu[0] <= volume.hu([nx / 2, ny / 2, *k])).unwrap();
    Input { name: "head", seed: [nx / 2, ny / 2, k], volume, hu }
}

/// Sheets of a gyroid with a period of 80 voxels in a ball, 500 HU, and -1000 around.
fn gyroid(size: usize) -> Input {
    let grid = Grid::axis_aligned([size; 3], [0.5; 3], [0.0; 3]).unwrap();
    let wave = |n: usize| (n as f64 * std::f64::consts::TAU / 80.0).sin_cos();
    let waves: Vec<(f64, f64)> = (0..size).map(wave).collect();
    let (middle, radius) = ((size as f64 - 1.0) / 2.0, size as f64 * 0.48);
    let value = |n: usize| {
        let index = [n % size, n / size % size, n / size / size];
        let [(sx, cx), (sy, cy), (sz, cz)] = index.map(|i| waves[i]);
        let from: f64 = index.iter().map(|i| (*i as f64 - middle).powi(2)).sum();
        let is_in = from <= radius * radius && (sx * cy + sy * cz + sz * cx).abs() < 0.5;
        if is_in { 500 } else { -1000 }
    };
    let voxels: Vec<i16> = (0..size * size * size).map(value).collect();
    let at = |n: usize| [n % size, n / size % size, n / size / size];
    let middle = size * size * (size / 2) + size * (size / 2) + size / 2;
    let seed = (middle..voxels.len()).find(|n| voxels[*n] > 0).map(at).unwrap();
    Input { name: "gyroid", volume: Volume::new(grid, voxels).unwrap(), seed, hu: [0, 1000] }
}

fn keep(folder: &Path, Input { name, volume, seed, hu }: &Input) {
    std::fs::write(folder.join(format!("{name}.raw")), bytemuck::cast_slice(volume.voxels_hu())).unwrap();
    let described = json!({
        "name": name, "dims": volume.grid().dims(), "spacing_mm": volume.grid().spacing_mm(), "seed": seed, "hu": hu,
    });
    std::fs::write(folder.join(format!("{name}.json")), described.to_string()).unwrap();
}

/// The median time of several runs, seconds, and the last result.
fn timed<T>(what: &str, repeat: usize, run: impl Fn() -> T) -> (f64, T) {
    let mut times = Vec::new();
    let mut last = None;
    for _ in 0..repeat.max(1) {
        drop(last.take());
        let start = Instant::now();
        last = Some(run());
        times.push(start.elapsed().as_secs_f64());
    }
    times.sort_by(f64::total_cmp);
    eprintln!("  {what}: {times:.3?} s");
    (times[times.len() / 2], last.unwrap())
}

fn measure(Input { name, volume, seed, hu }: &Input, repeat: usize) -> serde_json::Value {
    let seeds =
        vec![volume.grid().patient_from_voxel() * Point::new(seed[0] as f64, seed[1] as f64, seed[2] as f64)];
    let what = Grow { seeds, hu: *hu, limits: GrowLimits::default() };
    let (grow_s, grown) = timed("grow", repeat, || grow_region(volume, &what, &|_| true).unwrap());
    let (nets_s, mesh) = timed("surface", repeat, || surface_nets(&grown.mask).unwrap());
    let (smooth_s, smooth) = timed("smooth", 1, || mesh.smoothed(Smoothing::default()).unwrap());
    let (measure_s, measures) = timed("measure", 1, || smooth.measures());
    // Reducing a very large mesh to a tenth takes minutes and is not a use case.
    let is_light = smooth.triangles.len() <= MOST_DECIMATED;
    let decimated = is_light.then(|| {
        timed("decimate", 1, || smooth.decimated(Decimation::to(smooth.triangles.len() / 10)).unwrap())
    });
    let decimated = decimated.map(|(seconds, light)| {
        json!({ "s": seconds, "triangles": light.triangles.len(), "manifold": light.measures().is_manifold })
    });
    let map = grown.mask.to_labels(Segment::new(1, None, None));
    let SegmentIndices::Bytes(places) = map.places() else { unreachable!("one segment") };
    let sha256: String = Sha256::digest(places).iter().map(|byte| format!("{byte:02x}")).collect();
    json!({
        "name": name, "dims": volume.grid().dims(), "voxels": grown.voxels, "mask_sha256": sha256,
        "grow_s": grow_s, "nets_s": nets_s, "vertices": mesh.vertices.len(), "triangles": mesh.triangles.len(),
        "smooth_s": smooth_s, "measure_s": measure_s, "decimated": decimated,
        "manifold": measures.is_manifold, "euler": measures.euler, "volume_ml": measures.volume_ml,
        "voxels_ml": grown.volume_ml, "area_mm2": measures.area_mm2,
    })
}
