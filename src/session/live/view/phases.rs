//! The phases of a series, one at a time or one after the other.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::{Inner, View};
use crate::live::LiveError;
use crate::volumes::{VolumeEntry, Volumes};
use relief_base::OutOfRange;

/// After a longer pause phases go on where they stopped.
const LONGEST_PAUSE: Duration = Duration::from_secs(2);
/// Phases change the picture alone once the view has rested this long.
pub(super) const RESTS_AFTER: Duration = Duration::from_secs(1);

/// The phase with this number of a volume's series, from 1.
///
/// # Errors
/// When the series has no such phase.
pub fn find_phase(
    volumes: &Volumes,
    of: &Arc<VolumeEntry>,
    number: usize,
) -> Result<Arc<VolumeEntry>, OutOfRange> {
    let phases = volumes.phases_of(of);
    let is_chosen = |phase: &&Arc<VolumeEntry>| phase.phase().is_some_and(|phase| phase.number == number);
    phases.iter().find(is_chosen).cloned().ok_or_else(|| {
        let numbers = phases.iter().filter_map(|phase| Some(phase.phase()?.number.to_string()));
        let numbers = numbers.collect::<Vec<_>>().join(", ");
        let allowed = if numbers.is_empty() { "none: the volume has no phases".to_owned() } else { numbers };
        OutOfRange::new("settings.phase", number, allowed)
    })
}

impl View {
    /// Shows the phase that is due, while phases play; says when the next one is due. `phases` are
    /// those of a volume.
    pub(in crate::live) fn play(
        &self,
        phases: impl FnOnce(&Arc<VolumeEntry>) -> Vec<Arc<VolumeEntry>>,
        now: Instant,
    ) -> Option<Instant> {
        let outcome = self.lock().step(phases, now);
        outcome.unwrap_or_else(|error| {
            self.notify_failure(error);
            None
        })
    }

    /// The phase that will be shown next, while phases play.
    pub(in crate::live) fn next_phase(
        &self,
        phases: impl FnOnce(&Arc<VolumeEntry>) -> Vec<Arc<VolumeEntry>>,
    ) -> Option<Arc<VolumeEntry>> {
        let entry = {
            let inner = self.lock();
            let _ = inner.presentation.play?;
            Arc::clone(&inner.presentation.entry)
        };
        behind(&phases(&entry), &entry, 1)
    }
}

/// The phase that is some steps behind the one that is shown.
fn behind(phases: &[Arc<VolumeEntry>], shown: &VolumeEntry, steps: usize) -> Option<Arc<VolumeEntry>> {
    let at = phases.iter().position(|phase| phase.id == shown.id)?;
    phases.get((at + steps % phases.len()) % phases.len()).cloned()
}

impl Inner {
    fn step(
        &mut self,
        phases: impl FnOnce(&Arc<VolumeEntry>) -> Vec<Arc<VolumeEntry>>,
        now: Instant,
    ) -> Result<Option<Instant>, LiveError> {
        let Some(per_s) = self.presentation.play.filter(|_| !self.viewers.is_empty()) else {
            return Ok(None);
        };
        let interval = Duration::from_secs_f64(1.0 / per_s);
        let waited = now.saturating_duration_since(self.stepped);
        if waited < interval {
            return Ok(Some(self.stepped + interval));
        }
        // A slow renderer leaves phases out: the heart beats at its own pace.
        let steps = if waited > LONGEST_PAUSE.max(interval * 2) {
            self.stepped = now;
            1
        } else {
            let steps = (waited.as_secs_f64() * per_s).floor().max(1.0);
            self.stepped += interval.mul_f64(steps);
            steps as usize
        };
        let shown = &self.presentation.entry;
        if let Some(next) = behind(&phases(shown), shown, steps)
            && next.id != shown.id
        {
            match self.presentation.with_phase(next) {
                Ok(presentation) => self.presentation = presentation,
                Err(error) => {
                    self.presentation.play = None;
                    return Err(error);
                }
            }
            self.drawn_revision = None;
            self.renewed(now);
        }
        Ok(Some(self.stepped + interval))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::Viewer;
    use crate::live::presentation::Presentation;
    use crate::volumes::LoadedVolume;
    use relief_annotation::ShownSets;
    use relief_dicom::{Phase, SeriesIdentity};
    use relief_live::{Intent, Play, Role, Settings};
    use relief_volume::{Grid, Volume};

    const COUNT: usize = 5;

    /// Invariant: Phases play in order and at the requested rate, and the camera does not move.
    #[test]
    fn phases_follow_each_other_by_the_clock() {
        let volumes = Volumes::within(1 << 20);
        // Loaded in another order than their own.
        for number in [3, 1, 5, 2, 4] {
            let grid = Grid::axis_aligned([4; 3], [1.0; 3], [0.0; 3]).unwrap();
            let volume = Volume::new(grid, vec![100 * i16::try_from(number).unwrap(); 64]).unwrap();
            let identity = SeriesIdentity::new("1.2.6", "1.2.7").in_phase(Phase { number, count: COUNT }, 1);
            let (warnings, reference, labels) = (Vec::new(), None, None);
            let loaded = LoadedVolume { volume, warnings, identity: Some(identity), reference, labels };
            volumes.add_own(loaded, None).unwrap();
        }
        let first = find_phase(&volumes, &volumes.first().unwrap(), 1).unwrap();
        let settings = Settings { play: Some(Play::Phases { per_s: 10.0 }), ..Settings::default() };
        let presentation = Presentation::new(first, &settings, None).unwrap();
        let start = Instant::now();
        let at = |ms: u64| start + Duration::from_millis(ms);
        let view = View::new("a".to_owned(), presentation, start);
        let phases = |of: &Arc<VolumeEntry>| volumes.phases_of(of);
        assert_eq!(view.play(phases, at(100)), None, "nobody watches");
        view.join(&Viewer::new(1, Role::Presenter, false, None, start), &ShownSets::Nothing, start);
        let turn = Intent::Orbit { azimuth_deg: 40.0, elevation_deg: 0.0 };
        view.apply_intents(None, &[turn], 0, start);
        let camera = view.record().orientation_xyzw;
        // Milliseconds, the phase that is shown then, and when the next one is due.
        for (now, shown, due) in [
            (0, 1, 100),
            (99, 1, 100),
            (100, 2, 200),
            (205, 3, 300), // late
            (299, 3, 300), // on time all the same
            (510, 1, 600), // phases 4 and 5 are left out, and the first follows
            (600, 2, 700),
            (1200, 3, 1300), // a whole round is left out
            (9000, 4, 9100), // after a long pause with the next one
        ] {
            assert_eq!(view.play(phases, at(now)), Some(at(due)), "at {now} ms");
            assert_eq!(view.entry().phase().map(|phase| phase.number), Some(shown), "at {now} ms");
            assert_eq!(view.record().orientation_xyzw, camera, "at {now} ms");
        }
    }
}
