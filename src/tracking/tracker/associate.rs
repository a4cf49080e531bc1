//! The matching of blobs with LEDs, when the filter knows where each should be.
//!
//! Blobs are paired with the LEDs that could be there; every way to do so is scored by its squared
//! normalised innovation, a blob without LED by a fixed penalty. When two ways are nearly as good,
//! the frame is ambiguous.

use nalgebra::Vector2;

use super::TrackerOptions;
use super::sightings::Sightings;
use crate::beacon::{Beacon, MAX_LEDS};
use crate::filter::ErrorStateFilter;
use crate::sensor::Pinhole;
use crate::solve::Sighting;

/// Squared normalised innovation of one blob beyond which it is not that LED: 1 in 100,000 right
/// ones.
const PAIR_GATE: f64 = 23.0;
/// The cost of a blob without an LED: slightly more than the worst permitted pair.
const STRAY: f64 = 24.0;
/// The least advantage of the best way over one that calls a blob another LED.
const MARGIN: f64 = 12.0;

/// The kind of blobs.
#[derive(Clone, Copy, Debug)]
pub(super) enum Association {
    /// These LEDs.
    Matched(Sightings),
    /// There are two ways to see it.
    Ambiguous,
    /// None is an LED.
    Nothing,
}

pub(super) fn associate(
    filter: &ErrorStateFilter,
    camera: &Pinhole,
    beacon: &Beacon,
    blobs: &[Vector2<f64>],
    options: &TrackerOptions,
) -> Association {
    let mut search = Search {
        filter,
        camera,
        beacon,
        blobs,
        noise_px: options.noise_px,
        possible: [[false; MAX_LEDS]; 4],
        best: None,
        rival: f64::INFINITY,
    };
    search.find_possible(options.merge_px);
    search.extend(0, &mut [None; 4], &mut Sightings::default());
    match search.best {
        Some((score, ..)) if search.rival - score < MARGIN => Association::Ambiguous,
        Some((_, _, sightings)) if !sightings.as_slice().is_empty() => Association::Matched(sightings),
        _ => Association::Nothing,
    }
}

struct Search<'a> {
    filter: &'a ErrorStateFilter,
    camera: &'a Pinhole,
    beacon: &'a Beacon,
    blobs: &'a [Vector2<f64>],
    noise_px: f64,
    possible: [[bool; MAX_LEDS]; 4],
    best: Option<(f64, [Option<usize>; 4], Sightings)>,
    /// The best score that says something else of a blob than the best one.
    rival: f64,
}

impl Search<'_> {
    /// LEDs so close to another that the camera sees one blob are left out: it is neither's centre.
    fn find_possible(&mut self, merge_px: f64) {
        let pose = self.filter.pose();
        let mut expected = [None; MAX_LEDS];
        for (pixel, led) in expected.iter_mut().zip(self.beacon.leds()) {
            *pixel = self.camera.project(&pose.place(led));
        }
        for (led, position) in self.beacon.leds().iter().enumerate() {
            let Some(pixel) = expected[led] else { continue };
            let others = expected.iter().enumerate().filter(|(other, _)| *other != led);
            let merged = others.filter_map(|(_, o)| *o).any(|o: Vector2<f64>| (o - pixel).norm() < merge_px);
            if merged {
                continue;
            }
            for (at, blob) in self.blobs.iter().enumerate() {
                let sighting = Sighting { led: *position, pixel: *blob };
                let nis = self.filter.nis(self.camera, &[sighting], self.noise_px);
                self.possible[at][led] = nis.is_some_and(|nis| nis < PAIR_GATE);
            }
        }
    }

    fn extend(&mut self, at: usize, leds: &mut [Option<usize>; 4], sightings: &mut Sightings) {
        if at == self.blobs.len() {
            self.score(leds, sightings);
            return;
        }
        for led in 0..self.beacon.leds().len() {
            if self.possible[at][led] && !leds[..at].contains(&Some(led)) {
                leds[at] = Some(led);
                sightings.push(Sighting { led: self.beacon.leds()[led], pixel: self.blobs[at] });
                self.extend(at + 1, leds, sightings);
                sightings.pop();
            }
        }
        leds[at] = None;
        self.extend(at + 1, leds, sightings);
    }

    fn score(&mut self, leds: &[Option<usize>; 4], sightings: &Sightings) {
        let strays = (self.blobs.len() - sightings.as_slice().len()) as f64 * STRAY;
        if self.best.is_some_and(|(best, ..)| strays > best + MARGIN) {
            return; // however well the others fit
        }
        let Some(nis) = self.filter.nis(self.camera, sightings.as_slice(), self.noise_px) else { return };
        let score = nis + strays;
        let differs = |other: &[Option<usize>; 4]| {
            other.iter().zip(leds).any(|(a, b)| a.is_some() && b.is_some() && a != b)
        };
        match self.best {
            Some((best, known, _)) if score >= best => {
                if differs(&known) {
                    self.rival = self.rival.min(score);
                }
            }
            Some((best, known, _)) => {
                if differs(&known) {
                    self.rival = best;
                }
                self.best = Some((score, *leds, *sightings));
            }
            None => self.best = Some((score, *leds, *sightings)),
        }
    }
}
