//! Identifies the LED of each blob from their positions.
//!
//! Every assignment of blobs to LEDs is solved and scored with its chi-square: pixels, the
//! direction of gravity, and an earlier pose if there is one. The best is taken only when it
//! explains the view and every rival, be it another assignment or another pose of the same, is much
//! worse; else the view is ambiguous, and nothing is guessed.

use nalgebra::Vector2;

use super::beacon::{Beacon, MAX_LEDS};
use super::pose::Pose;
use super::sensor::Pinhole;
use super::solve::{Gravity, MAX_SEEN, Minimum, PoseView, Sighting};

/// Chi-square that an assignment may have, per the number of equations beyond the six unknowns. A
/// right one has more in 1 of 20,000 views with two, which is what four LEDs have.
pub(crate) const GATE: f64 = 20.0;
/// Chi-square by which every rival has to be worse: it is the logarithm of how much less likely it
/// is, times two.
pub const MARGIN: f64 = 25.0;

/// Starts with a larger chi-square are not refined: a start has a few times that of its minimum.
const HOPELESS: f64 = 100.0 * (GATE + MARGIN);

/// An earlier pose and its largest change since.
#[derive(Clone, Copy, Debug)]
pub struct EarlierPose {
    /// `sensor_from_beacon`.
    pub pose: Pose,
    /// Standard deviation of the turn since, radians.
    pub sigma_angle: f64,
    /// Standard deviation of the shift since, mm.
    pub sigma_mm: f64,
    /// The largest movement of an LED's picture since then, px: farther blobs are not tried.
    pub reach_px: f64,
}

/// Knowledge besides the blobs.
#[derive(Clone, Copy, Debug, Default)]
pub struct IdentifyHints {
    /// Up.
    pub gravity: Option<Gravity>,
    /// An earlier pose.
    pub earlier: Option<EarlierPose>,
}

/// Blobs with their LEDs: `leds[i]` is that of blob i.
pub(crate) type Assignment = [Option<usize>; MAX_SEEN];

/// The result for a view.
#[derive(Clone, Copy, Debug)]
#[expect(clippy::large_enum_variant, reason = "one lives at a time, and nothing is allocated")]
pub enum Identified {
    /// One assignment explains it, and no other nearly as well.
    Found {
        /// Blob i is LED `assignment[i]`.
        assignment: Assignment,
        /// The pose.
        refined: Minimum,
        /// Chi-square of the best rival; infinite without a rival.
        rival: f64,
    },
    /// Several assignments or poses explain it.
    Ambiguous {
        /// Chi-square of the best.
        best: f64,
        /// Chi-square of its best rival.
        rival: f64,
    },
    /// None explains it; the chi-square of the best, if any has a pose.
    Unexplained(Option<f64>),
}

/// Solves every assignment of two to four blobs (pixels) to the beacon's LEDs.
///
/// Fewer than four blobs are explained by many assignments, so they are identified only with good
/// hints.
#[must_use]
pub fn identify_blobs(
    camera: &Pinhole,
    beacon: &Beacon,
    blobs: &[Vector2<f64>],
    noise_px: f64,
    hints: &IdentifyHints,
) -> Identified {
    let blobs = &blobs[..blobs.len().min(MAX_SEEN)];
    let mut search = Search { camera, beacon, blobs, noise_px, hints, best: None, rival: f64::INFINITY };
    search.assign(&mut [0; MAX_SEEN], 0);
    let rival = search.rival;
    match search.best {
        Some((score, ..)) if score > GATE => Identified::Unexplained(Some(score)),
        Some((best, ..)) if rival - best < MARGIN => Identified::Ambiguous { best, rival },
        Some((_, assignment, refined)) => Identified::Found { assignment, refined, rival },
        None => Identified::Unexplained(None),
    }
}

struct Search<'a> {
    camera: &'a Pinhole,
    beacon: &'a Beacon,
    blobs: &'a [Vector2<f64>],
    noise_px: f64,
    hints: &'a IdentifyHints,
    best: Option<(f64, Assignment, Minimum)>,
    rival: f64,
}

impl Search<'_> {
    /// Assigns every free LED to blob `at`, then to those after it, and scores complete
    /// assignments.
    fn assign(&mut self, leds: &mut [usize; MAX_SEEN], at: usize) {
        if at == self.blobs.len() {
            self.score(leds);
            return;
        }
        for led in 0..self.beacon.leds().len().min(MAX_LEDS) {
            if !leds[..at].contains(&led) && self.is_within_reach(at, led) {
                leds[at] = led;
                self.assign(leds, at + 1);
            }
        }
    }

    fn is_within_reach(&self, blob: usize, led: usize) -> bool {
        let Some(earlier) = self.hints.earlier else { return true };
        let expected = self.camera.project(&earlier.pose.place(&self.beacon.leds()[led]));
        expected.is_some_and(|expected| (expected - self.blobs[blob]).norm() <= earlier.reach_px)
    }

    fn score(&mut self, leds: &[usize; MAX_SEEN]) {
        let sighting = |at: usize| {
            let at = at.min(self.blobs.len().saturating_sub(1));
            Sighting { led: self.beacon.leds()[leds[at]], pixel: self.blobs[at] }
        };
        if self.blobs.is_empty() {
            return;
        }
        let sightings: [Sighting; MAX_SEEN] = std::array::from_fn(sighting);
        let sightings = &sightings[..self.blobs.len()];
        let view =
            PoseView { camera: self.camera, sightings, noise_px: self.noise_px, gravity: self.hints.gravity };
        let Some(solutions) = view.solve_below(HOPELESS) else { return };
        for refined in [Some(solutions.best), solutions.second].into_iter().flatten() {
            let score = refined.cost + self.hints.earlier.map_or(0.0, |earlier| earlier.cost(&refined.pose));
            let mut assignment = [None; MAX_SEEN];
            for (slot, led) in assignment.iter_mut().zip(&leds[..self.blobs.len()]) {
                *slot = Some(*led);
            }
            match self.best {
                Some((best, ..)) if score >= best => self.rival = self.rival.min(score),
                _ => {
                    self.rival = self.best.map_or(self.rival, |(best, ..)| best);
                    self.best = Some((score, assignment, refined));
                }
            }
        }
    }
}

impl EarlierPose {
    fn cost(&self, pose: &Pose) -> f64 {
        let (angle, distance) = self.pose.inverse_distance(pose);
        (angle / self.sigma_angle).powi(2) + (distance / self.sigma_mm).powi(2)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::super::design::{DesignConditions, DesignScore, score_design};
    use super::super::solve::random::{Random, ViewRange};
    use super::*;

    fn counts(beacon: &Beacon, views: usize, seed: u64, with_gravity: bool) -> DesignScore {
        let gravity_sigma = with_gravity.then_some(2_f64.to_radians());
        let conditions = DesignConditions { views, seed, gravity_sigma, ..DesignConditions::default() };
        score_design(beacon, &conditions)
    }

    /// Invariant: An ambiguous view has no pose.
    ///
    /// A layout that looks the same from two sides: its views are ambiguous, and none is guessed.
    #[test]
    fn a_symmetric_beacon_is_reported_as_ambiguous() {
        let beacon =
            Beacon::new(&[[-50.0, 0.0, 0.0], [50.0, 0.0, 0.0], [0.0, 30.0, 60.0], [0.0, -30.0, 60.0]])
                .unwrap();
        let counts = counts(&beacon, 60, 1, false);
        assert_eq!((counts.wrong, counts.right), (0, 0));
        assert!(counts.ambiguous >= 58, "{}", counts.ambiguous);
    }

    #[test]
    fn the_recommended_beacon_is_identified_with_gravity() {
        let counts = counts(&Beacon::recommended(), 300, 2, true);
        assert_eq!(counts.wrong, 0);
        assert!(counts.unexplained <= 1, "{}", counts.unexplained);
        assert!(counts.right >= 285, "{} right, {} ambiguous", counts.right, counts.ambiguous);
    }

    /// The last pose decides where four blobs alone are ambiguous.
    #[test]
    fn an_earlier_pose_settles_ambiguous_views() {
        let beacon = Beacon::recommended();
        let (camera, mut random) = (Pinhole::TYPICAL, Random::new(3));
        for _ in 0..100 {
            let truth = random.view(&beacon, &camera, &ViewRange::USUAL);
            let blobs: Vec<_> =
                beacon.leds().iter().map(|l| camera.project(&truth.place(l)).unwrap()).collect();
            let aside = Rotation3::from_scaled_axis(random.normal3() * 0.01);
            let pose = Pose { rotation: aside * truth.rotation, ..truth };
            let earlier = Some(EarlierPose { pose, sigma_angle: 0.03, sigma_mm: 60.0, reach_px: 150.0 });
            let found =
                identify_blobs(&camera, &beacon, &blobs, 0.58, &IdentifyHints { gravity: None, earlier });
            let Identified::Found { assignment, .. } = found else { panic!("{found:?}") };
            assert_eq!(assignment, [Some(0), Some(1), Some(2), Some(3)]);
        }
    }

    #[test]
    fn blobs_of_something_else_are_unexplained() {
        let blobs =
            [(100.0, 100.0), (900.0, 120.0), (500.0, 130.0), (520.0, 110.0)].map(|(u, v)| Vector2::new(u, v));
        let found = identify_blobs(
            &Pinhole::TYPICAL,
            &Beacon::recommended(),
            &blobs,
            0.58,
            &IdentifyHints::default(),
        );
        assert!(matches!(found, Identified::Unexplained(_)), "{found:?}");
        let none =
            identify_blobs(&Pinhole::TYPICAL, &Beacon::recommended(), &[], 0.58, &IdentifyHints::default());
        assert!(matches!(none, Identified::Unexplained(None)));
    }
}
