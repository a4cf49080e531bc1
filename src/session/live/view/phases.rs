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
