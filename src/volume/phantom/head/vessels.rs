//! Arteries and veins filled with contrast medium.
//!
//! Main trunks follow textbook courses; the branches on the brain's surface grow from a seed.
//! Arteries and veins have one value each, as in a late arterial phase.

use glam::Vec3;

use super::super::noise::vector_noise;
use super::super::sdf::Field;

const REACH_MM: f32 = 2.5;

/// Arteries.
pub(super) fn arteries(cavity: &Field, seed: u64) -> Field {
    let mut tree = Field::new(REACH_MM);
    carotids(&mut tree);
    vertebrals(&mut tree);
    circle_of_willis(&mut tree);
    for (start, toward, radius) in [
        ([40.0f32, -16.0, 38.0], [60.0f32, 10.0, 90.0], 1.4f32),
        ([42.0, -12.0, 36.0], [66.0, 50.0, 66.0], 1.4),
        ([42.0, -14.0, 36.0], [66.0, 30.0, 20.0], 1.3),
        ([40.0, -18.0, 38.0], [58.0, -50.0, 70.0], 1.3),
    ] {
        for side in [1.0, -1.0] {
            let mirror = Vec3::new(side, 1.0, 1.0);
            let (start, toward) = (Vec3::from(start) * mirror, Vec3::from(toward) * mirror);
            tree.join_path(0.6, &crawl(cavity, start, toward, radius, seed));
        }
    }
    tree
}

fn carotids(tree: &mut Field) {
    tree.join_path_both(
        0.0,
        &[[25.0, -12.0, -145.0, 3.6], [26.0, -12.0, -110.0, 3.6], [28.0, -10.0, -88.0, 4.4]],
    );
    tree.join_path_both(
        1.0,
        &[
            [28.0, -10.0, -88.0, 3.6],
            [30.0, -3.0, -66.0, 2.7],
            [26.0, -4.0, -36.0, 2.6],
            [27.0, -6.0, -12.0, 2.6],
            [25.0, -7.0, 2.0, 2.5],
            [16.0, -10.0, 7.0, 2.5],
            [12.0, -13.0, 16.0, 2.4],
            [12.0, -24.0, 20.0, 2.4],
            [11.0, -28.0, 26.0, 2.3],
            [12.0, -22.0, 32.0, 2.2],
            [14.0, -20.0, 36.0, 2.1],
        ],
    );
    tree.join_path_both(
        1.0,
        &[
            [28.0, -10.0, -88.0, 3.0],
            [36.0, -14.0, -70.0, 2.3],
            [44.0, -8.0, -44.0, 2.1],
            [54.0, -10.0, -18.0, 1.9],
            [66.5, -11.0, 6.0, 1.3],
            [70.0, -16.0, 34.0, 1.1],
            [66.5, -28.0, 66.0, 0.8],
        ],
    ); // external carotid, superficial temporal
    tree.join_path_both(
        0.8,
        &[
            [36.0, -16.0, -72.0, 1.6],
            [38.0, -36.0, -76.0, 1.3],
            [42.0, -54.0, -66.0, 1.2],
            [32.0, -78.0, -42.0, 1.0],
            [18.0, -89.0, -12.0, 0.8],
        ],
    ); // facial artery
}

fn vertebrals(tree: &mut Field) {
    // The left one is the larger, as in most people.
    for (side, r) in [(1.0f32, 2.0f32), (-1.0, 1.6)] {
        tree.join_path(
            0.6,
            &[
                [20.0 * side, 17.0, -145.0, r],
                [21.0 * side, 18.0, -90.0, r],
                [23.0 * side, 19.0, -50.0, r],
                [31.0 * side, 20.0, -36.0, r],
                [24.0 * side, 33.0, -27.0, r],
                [11.0 * side, 28.0, -21.0, r],
                [4.0 * side, 10.0, -12.0, r],
                [0.0, -3.0, -2.0, r],
            ],
        );
    }
    tree.join_path(0.6, &[[0.0, -2.5, -3.0, 2.2], [0.6, -6.5, 8.0, 2.0], [0.0, -6.0, 23.0, 2.0]]); // basilar
}

fn circle_of_willis(tree: &mut Field) {
    tree.join_path_both(
        0.8,
        &[
            [14.0, -20.0, 36.0, 1.9],
            [24.0, -21.0, 36.0, 1.8],
            [33.0, -19.0, 36.0, 1.8],
            [42.0, -14.0, 37.0, 1.6],
        ],
    );
    tree.join_path_both(
        0.8,
        &[
            [13.0, -21.0, 35.5, 1.6],
            [6.0, -26.0, 37.0, 1.5],
            [1.9, -34.0, 42.0, 1.5],
            [1.8, -43.0, 53.0, 1.4],
            [1.8, -38.0, 66.0, 1.3],
            [1.8, -20.0, 75.0, 1.2],
            [1.8, 8.0, 78.0, 1.1],
            [1.8, 36.0, 74.0, 0.9],
        ],
    ); // anterior cerebral
    // Anterior communicating.
    tree.join_path(0.5, &[[6.0, -26.0, 37.0, 1.0], [0.0, -27.5, 37.5, 1.1], [-6.0, -26.0, 37.0, 1.0]]);
    tree.join_path_both(
        0.8,
        &[
            [0.0, -6.0, 23.0, 1.7],
            [9.0, -3.0, 25.0, 1.6],
            [17.0, 10.0, 29.0, 1.5],
            [18.0, 28.0, 34.0, 1.4],
            [12.0, 56.0, 38.0, 1.1],
            [10.0, 78.0, 40.0, 0.9],
        ],
    ); // posterior cerebral
    // Posterior communicating.
    tree.join_path_both(0.4, &[[13.0, -20.0, 34.0, 1.0], [11.0, -10.0, 29.0, 0.9], [9.0, -3.0, 25.0, 1.0]]);
    tree.join_path_both(
        0.6,
        &[[0.0, -5.0, 20.0, 1.1], [12.0, -1.0, 21.0, 1.0], [24.0, 22.0, 20.0, 0.9], [20.0, 46.0, 22.0, 0.8]],
    ); // superior cerebellar
}

/// Veins.
pub(super) fn veins(cavity: &Field, seed: u64) -> Field {
    let mut tree = Field::new(REACH_MM);
    sagittal_sinus(&mut tree, cavity);
    // The right transverse sinus is the larger, as in most people.
    for (side, r) in [(1.0f32, 3.0f32), (-1.0, 4.0)] {
        tree.join_path(
            2.0,
            &[
                [0.0, 81.5, 10.0, r],
                [20.0 * side, 76.5, 10.0, r],
                [40.0 * side, 62.0, 8.0, r],
                [52.0 * side, 42.0, 6.0, r],
                [51.0 * side, 26.0, -2.0, r],
                [42.0 * side, 18.0, -11.0, r],
                [29.0 * side, 9.0, -14.0, r],
                [31.0 * side, 5.0, -30.0, r + 0.8],
                [34.0 * side, 0.0, -70.0, r + 1.8],
                [33.0 * side, -8.0, -110.0, r + 2.4],
                [30.0 * side, -10.0, -145.0, r + 2.8],
            ],
        );
    }
    tree.join_path(
        1.0,
        &[[0.0, 30.0, 45.0, 1.6], [0.0, 40.0, 44.0, 2.0], [0.0, 60.0, 27.0, 2.2], [0.0, 80.0, 11.0, 2.6]],
    ); // straight sinus
    // Internal cerebral.
    tree.join_path_both(0.5, &[[4.0, -8.0, 53.0, 0.9], [3.0, 10.0, 56.0, 1.1], [1.0, 30.0, 46.0, 1.3]]);
    for (n, y) in [-58.0f32, -36.0, -14.0, 10.0, 34.0, 56.0].into_iter().enumerate() {
        for side in [1.0, -1.0] {
            let start =
                on_wall(cavity, Vec3::new(side * 1.5, y, 60.0 + 30.0 * (1.0 - (y / 80.0).powi(2))), 3.5);
            let toward = Vec3::new(side * 66.0, y - 14.0, 62.0 - 8.0 * (n % 2) as f32);
            let mut bridge = crawl(cavity, start, toward, 1.3, seed ^ (n as u64 + 17));
            bridge.truncate(6);
            tree.join_path(0.6, &bridge);
        }
    }
    tree
}

/// Along the inner table in the midline, from the forehead to the confluence.
fn sagittal_sinus(tree: &mut Field, cavity: &Field) {
    let center = Vec3::new(0.0, 4.0, 36.0);
    let points: Vec<[f32; 4]> = (0..=12)
        .map(|n| {
            let t = n as f32 / 12.0;
            let angle = -0.15 + t * 3.55; // from the front over the top to the back
            let outward = Vec3::new(0.0, -angle.cos(), angle.sin());
            let radius = 1.4 + 2.6 * t;
            let at = on_wall(cavity, center + outward * 20.0, radius * 0.6);
            let at = if n == 12 { Vec3::new(0.0, 81.5, 10.0) } else { at };
            [at.x, at.y, at.z, radius]
        })
        .collect();
    tree.join_path(1.0, &points);
}

/// The point `depth` mm inside the cavity's wall, seen from its middle through `p`.
fn on_wall(cavity: &Field, p: Vec3, depth: f32) -> Vec3 {
    let center = Vec3::new(0.0, 4.0, 36.0);
    let outward = (p - center).normalize_or_zero();
    let (mut low, mut high) = (0.0, 140.0);
    for _ in 0..24 {
        let middle = (low + high) / 2.0;
        if cavity.distance(center + outward * middle) < -depth { low = middle } else { high = middle }
    }
    center + outward * low
}

/// A branch that wanders over the brain's surface from `start` to `toward`, thinning out.
fn crawl(cavity: &Field, start: Vec3, toward: Vec3, radius: f32, seed: u64) -> Vec<[f32; 4]> {
    const STEPS: usize = 9;
    (0..=STEPS)
        .map(|n| {
            let t = n as f32 / STEPS as f32;
            let straight = start + (toward - start) * t;
            let astray =
                straight + 16.0 * (t * (1.0 - t)) * 2.0 * vector_noise(straight / 14.0, seed ^ 0xa27);
            let at =
                if n == 0 { start } else { straight.lerp(on_wall(cavity, astray, 3.0), (3.0 * t).min(1.0)) };
            [at.x, at.y, at.z, radius * (1.0 - 0.55 * t)]
        })
        .collect()
}
