//! The accuracy of placing landmarks with a Wiimote and other pointers, by simulation of the whole
//! chain.
//!
//! The hand (see `hand`) is tracked by the product's tracker and gestures, other devices are in
//! `pointer`; the landmark is
//! rendered, picked and snapped by the product's renderer and snapping (see `chain`). Errors are
//! distances from the true landmark of the head phantom, mm.

mod chain;
mod hand;
mod pointer;
pub(crate) mod report;

use std::collections::BTreeSet;

use serde::Serialize;

use self::chain::Visibility;
use crate::StudyError;
use crate::accuracy::report::WayReport;
pub use pointer::PointerKind;
use relief_render::Renderer;
use relief_volume::Phantom;

/// The settings of a simulation.
#[derive(Clone, Debug)]
pub struct AccuracySettings {
    /// The devices to place with.
    pub pointers: Vec<PointerKind>,
    /// Distance from the beacon to the remote, mm.
    pub distance_mm: f64,
    /// Placements of each landmark and seed.
    pub repeats: u32,
    /// Radius of snapping, mm.
    pub radius_mm: f64,
    /// Peak acceleration of the tremor, standard gravities.
    pub tremor_g: f64,
    /// Whether to cut away tissue that hides a landmark in all standard views.
    pub cut: bool,
    /// Seeds of the random numbers; the spread of their medians shows the influence of chance.
    pub seeds: Vec<u64>,
}

/// The errors of all ways to place landmarks.
#[derive(Debug, Serialize)]
pub struct AccuracyReport {
    /// Distance from the beacon to the remote, mm.
    pub distance_mm: f64,
    /// Number of landmarks.
    pub landmarks: usize,
    /// Placements of each landmark and seed.
    pub repeats: u32,
    /// Seeds of the random numbers.
    pub seeds: Vec<u64>,
    /// Radius of snapping, mm.
    pub radius_mm: f64,
    /// Peak acceleration of the tremor, standard gravities.
    pub tremor_g: f64,
    /// Number of landmarks that were visible only after cutting tissue away.
    pub cut: usize,
    /// Number of landmarks that were visible in no view.
    pub hidden: usize,
    /// The ways, each with its errors.
    pub ways: Vec<WayReport>,
}

/// Places the landmarks of a head phantom in all ways.
///
/// # Errors
/// When a simulated hand is lost, or rendering fails.
pub fn measure_accuracy(
    settings: &AccuracySettings,
    phantom: &Phantom,
    renderer: &mut Renderer,
) -> Result<AccuracyReport, StudyError> {
    let &AccuracySettings { distance_mm, repeats, radius_mm, tremor_g, .. } = settings;
    let mut ways: Vec<_> =
        settings.pointers.iter().flat_map(|pointer| WayReport::all(*pointer, distance_mm)).collect();
    let landmarks = &phantom.truth.landmarks;
    let count = repeats as usize;
    let (mut cut, mut hidden) = (BTreeSet::new(), BTreeSet::new());
    for &seed in &settings.seeds {
        let placer = hand::SimulatedHand { distance_mm, tremor_g, seed };
        let mut placings = Vec::new();
        for pointer in &settings.pointers {
            let mappings: Vec<_> =
                pointer.mappings(distance_mm).into_iter().map(|(_, mapping)| mapping).collect();
            placings.push(pointer.place(placer, &mappings, landmarks.len() * count, chain::HEIGHT_MM)?);
        }
        for (at, landmark) in landmarks.iter().enumerate() {
            let (seed, cuts) = (seed ^ at as u64, settings.cut);
            let shown = chain::PresentedLandmark::new(renderer, &phantom.volume, landmark, seed, cuts)
                .map_err(|source| StudyError::Landmark {
                    landmark: landmark.name.to_string(),
                    source: Box::new(source),
                })?;
            match shown.sight {
                Visibility::Plain => false,
                Visibility::Cut => cut.insert(at),
                Visibility::Hidden => hidden.insert(at),
            };
            for way in &mut ways {
                let of_pointer =
                    settings.pointers.iter().zip(&placings).find(|(one, _)| **one == way.pointer);
                let Some((_, offsets)) = of_pointer else { continue };
                for offsets in &offsets[at * count..][..count] {
                    shown.place(&phantom.volume, offsets[way.number], radius_mm, way);
                }
            }
        }
        ways.iter_mut().for_each(WayReport::end_seed);
    }
    ways.iter_mut().for_each(WayReport::summarise);
    Ok(AccuracyReport {
        distance_mm,
        landmarks: landmarks.len(),
        repeats,
        seeds: settings.seeds.clone(),
        radius_mm,
        tremor_g,
        cut: cut.len(),
        hidden: hidden.len(),
        ways,
    })
}
