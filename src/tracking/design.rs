//! Layouts of LEDs: how reliably a beacon's views are identified, and how accurately they determine
//! poses.
//!
//! [`score_design`] identifies random views with noise, rounded to whole pixels, their blobs in any
//! order. [`search_design`] tries layouts within a box: random ones first, then changes of the
//! best. What counts is the margin of the rivals in the worst twentieth of the views: a beacon with
//! a large one needs no guessing.

use nalgebra::{Rotation3, Unit, Vector2};

use super::beacon::Beacon;
use super::correspondence::{Identified, IdentifyHints, identify_blobs};
use super::pose::Pose;
use super::sensor::Pinhole;
use super::solve::bound::quantised_noise;
use super::solve::random::{Random, ViewRange};
use super::solve::{Gravity, PoseView, Sighting};

/// How layouts are tried.
#[derive(Clone, Copy, Debug)]
pub struct DesignConditions {
    /// The camera.
    pub camera: Pinhole,
    /// From where it looks.
    pub range: ViewRange,
    /// Noise before rounding, px.
    pub noise_px: f64,
    /// Standard deviation of up, radians; without it, none is known.
    pub gravity_sigma: Option<f64>,
    /// LEDs whose pictures are nearer than this are one blob, px.
    pub merge_px: f64,
    /// The number of views.
    pub views: usize,
    /// Seed of the views.
    pub seed: u64,
}

impl Default for DesignConditions {
    fn default() -> Self {
        Self {
            camera: Pinhole::TYPICAL,
            range: ViewRange::USUAL,
            noise_px: 0.5,
            gravity_sigma: Some(3_f64.to_radians()),
            merge_px: 16.0,
            views: 200,
            seed: 0,
        }
    }
}

/// The score of a layout.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct DesignScore {
    /// Views identified rightly.
    pub right: usize,
    /// Views identified wrongly.
    pub wrong: usize,
    /// Views reported as ambiguous.
    pub ambiguous: usize,
    /// Views that nothing explained.
    pub unexplained: usize,
    /// Views in which two LEDs merge into one blob; not counted in the fields above.
    pub merged: usize,
    /// Chi-square by which the best rival is worse, in the worst twentieth of the views.
    pub margin: f64,
    /// Root mean square of the bound of the position, mm.
    pub position_mm: f64,
    /// Root mean square of the bound of the turn, degrees.
    pub turn_deg: f64,
}

/// A rival this much worse is as good as none.
const ENOUGH: f64 = 1000.0;

/// Tries a beacon whose first four LEDs are seen.
#[must_use]
pub fn score_design(beacon: &Beacon, conditions: &DesignConditions) -> DesignScore {
    let mut random = Random::new(conditions.seed);
    let mut score = DesignScore {
        right: 0,
        wrong: 0,
        ambiguous: 0,
        unexplained: 0,
        merged: 0,
        margin: 0.0,
        position_mm: 0.0,
        turn_deg: 0.0,
    };
    let mut margins = Vec::with_capacity(conditions.views);
    for _ in 0..conditions.views {
        let truth = random.view(beacon, &conditions.camera, &conditions.range);
        margins.push(try_view(beacon, conditions, &truth, &mut random, &mut score));
        if let Some(bound) = bound_of(beacon, conditions, &truth) {
            score.position_mm += bound.fixed_view::<3, 3>(0, 0).trace();
            score.turn_deg += bound.fixed_view::<3, 3>(3, 3).trace();
        }
    }
    margins.sort_by(f64::total_cmp);
    let count = conditions.views.max(1) as f64;
    score.margin = margins.get(margins.len() / 20).copied().unwrap_or(0.0);
    score.position_mm = (score.position_mm / count).sqrt();
    score.turn_deg = (score.turn_deg / count).sqrt().to_degrees();
    score
}

fn bound_of(beacon: &Beacon, conditions: &DesignConditions, truth: &Pose) -> Option<nalgebra::Matrix6<f64>> {
    let see = |led: &nalgebra::Vector3<f64>| {
        Some(Sighting { led: *led, pixel: conditions.camera.project(&truth.place(led))? })
    };
    let seen: Vec<Sighting> = beacon.leds().iter().take(4).filter_map(see).collect();
    let noise_px = quantised_noise(conditions.noise_px);
    PoseView { camera: &conditions.camera, sightings: &seen, noise_px, gravity: None }.bound(truth)
}

/// Identifies one view; gives the margin of its best rival.
fn try_view(
    beacon: &Beacon,
    conditions: &DesignConditions,
    truth: &Pose,
    random: &mut Random,
    score: &mut DesignScore,
) -> f64 {
    let mut order = [0, 1, 2, 3];
    for i in (1..4).rev() {
        order.swap(i, (random.bits() % (i as u64 + 1)) as usize);
    }
    let blobs = order.map(|led| {
        let noise = Vector2::new(random.normal(), random.normal()) * conditions.noise_px;
        let pixel = conditions.camera.project(&truth.place(&beacon.leds()[led])).unwrap_or_default();
        (pixel + noise).map(f64::round)
    });
    let tilt = Rotation3::from_scaled_axis(random.normal3() * conditions.gravity_sigma.unwrap_or(0.0));
    let near = |a: usize, b: usize| (blobs[a] - blobs[b]).norm() < conditions.merge_px;
    if (1..4).any(|a| (0..a).any(|b| near(a, b))) {
        score.merged += 1;
        return 0.0;
    }
    let up_in_sensor = Unit::new_normalize(tilt * truth.rotation * beacon.up().into_inner());
    let gravity =
        conditions.gravity_sigma.map(|sigma| Gravity { up_in_beacon: *beacon.up(), up_in_sensor, sigma });
    let hints = IdentifyHints { gravity, earlier: None };
    match identify_blobs(&conditions.camera, beacon, &blobs, quantised_noise(conditions.noise_px), &hints) {
        Identified::Found { assignment, refined, rival } => {
            let is_right = assignment == order.map(Some);
            *(if is_right { &mut score.right } else { &mut score.wrong }) += 1;
            if is_right { (rival - refined.cost).min(ENOUGH) } else { 0.0 }
        }
        Identified::Ambiguous { best, rival } => {
            score.ambiguous += 1;
            rival - best
        }
        Identified::Unexplained(_) => {
            score.unexplained += 1;
            0.0
        }
    }
}

/// Tries `layouts` layouts of four LEDs within a box of this size (mm, centred in x and y, from z =
/// 0 on), coordinates in whole multiples of 5 mm; returns the best with its score. Calls `tried`
/// after each.
#[must_use]
pub fn search_design(
    size_mm: [f64; 3],
    layouts: usize,
    conditions: &DesignConditions,
    tried: &dyn Fn(usize),
) -> Option<(Beacon, DesignScore)> {
    let mut random = Random::new(conditions.seed ^ 0x5eed);
    let mut best: Option<([[f64; 3]; 4], Beacon, DesignScore)> = None;
    for at in 0..layouts {
        let positions: [[f64; 3]; 4] = match &best {
            Some((positions, ..)) if at >= layouts / 2 => {
                positions.map(|led| moved(led, size_mm, 0.15, &mut random))
            }
            _ => std::array::from_fn(|_| moved([0.0, 0.0, size_mm[2] / 2.0], size_mm, 1.0, &mut random)),
        };
        tried(at + 1);
        let Ok(beacon) = Beacon::new(&positions) else { continue };
        // A layout that is worse than the best in its first views is not followed to the end.
        let quick = DesignConditions { views: conditions.views / 4, ..*conditions };
        let so_far = best.as_ref().map_or(0.0, |(.., score)| merit(score));
        if merit(&score_design(&beacon, &quick)) < 0.6 * so_far {
            continue;
        }
        let found = score_design(&beacon, conditions);
        if merit(&found) > so_far {
            best = Some((positions, beacon, found));
        }
    }
    best.map(|(_, beacon, score)| (beacon, score))
}

/// The margin, and of equal margins the accuracy.
fn merit(score: &DesignScore) -> f64 {
    score.margin / (1.0 + score.position_mm / 20.0)
}

/// A place within the box, at most this share of its size away.
fn moved(led: [f64; 3], size_mm: [f64; 3], share: f64, random: &mut Random) -> [f64; 3] {
    std::array::from_fn(|axis| {
        let half = size_mm[axis] / 2.0;
        let centre = if axis == 2 { half } else { 0.0 };
        let there = led[axis] + random.between(-1.0, 1.0) * half * share;
        let there = there.clamp(centre - half, centre + half);
        (there / 5.0).round() * 5.0
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small search beats the layout that everybody thinks of first.
    #[test]
    fn a_search_finds_a_better_layout_than_a_regular_one() {
        let conditions = DesignConditions { views: 40, ..DesignConditions::default() };
        let regular =
            Beacon::new(&[[-100.0, -57.7, 0.0], [100.0, -57.7, 0.0], [0.0, 115.5, 0.0], [0.0, 0.0, 100.0]])
                .unwrap();
        let regular = score_design(&regular, &conditions);
        let (beacon, found) = search_design([240.0, 160.0, 120.0], 24, &conditions, &|_| ()).unwrap();
        assert!(found.margin > regular.margin, "{found:?} {regular:?}");
        assert_eq!((found.wrong, regular.wrong), (0, 0));
        for led in beacon.leds() {
            assert!(led.x.abs() <= 120.0 && led.y.abs() <= 80.0 && (0.0..=120.0).contains(&led.z), "{led}");
        }
    }
}
