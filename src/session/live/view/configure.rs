//! Settings of a view, except for its camera.

use std::sync::Arc;
use std::time::Instant;

use super::{Inner, View};
use crate::live::LiveError;
use crate::volumes::VolumeEntry;
use relief_live::{Intent, Settings, ViewState};

impl View {
    /// Changes the presentation; `entry` is another volume. Works outside of the lock, and once more
    /// if another presenter has changed it meanwhile: neither setting is lost.
    ///
    /// # Errors
    /// When a setting is invalid; the view has not changed then.
    pub fn configure(
        &self,
        settings: &Settings,
        entry: Option<&Arc<VolumeEntry>>,
        author: Option<&str>,
        now: Instant,
    ) -> Result<(), LiveError> {
        let (presentation, mut inner) = loop {
            let (before, seen) = {
                let inner = self.lock();
                (inner.presentation.clone(), inner.settings)
            };
            let presentation = before.with(settings, entry.cloned(), author)?;
            let inner = self.lock();
            if inner.settings == seen {
                break (presentation, inner);
            }
        };
        inner.settings += 1;
        // The same volume may have another label map by now.
        let is_another = presentation.entry.id != inner.presentation.entry.id;
        // Another phase is seen from where the view is.
        let is_other = is_another && !presentation.entry.is_phase_with(&inner.presentation.entry);
        if settings.play.is_some() || is_another {
            inner.stepped = now;
        }
        if is_other {
            inner.state = ViewState::home(&presentation.stage);
            inner.camera = None;
        }
        let known = &inner.presentation;
        if is_another || (&presentation.shown, &presentation.shown_to) != (&known.shown, &known.shown_to) {
            // The held point belongs to the former annotations: it stays where it was.
            inner.epoch += 1;
            inner.held = None;
        }
        if is_another || settings.annotations.is_some() {
            inner.drawn_revision = None;
        }
        let preset = presentation.preset.clone();
        inner.presentation = presentation;
        inner.preview.forget();
        inner.still_took = None;
        if let Some(name) = preset {
            let intent = Intent::Preset { name: Some(name), step: None };
            let Inner { state, presentation, .. } = &mut *inner;
            state.apply(&presentation.stage, 0, &intent, None)?;
        }
        inner.changed(now);
        drop(inner);
        self.work.notify_one();
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live::presentation::Presentation;
    use crate::volumes::{LoadedVolume, Volumes};
    use relief_live::Quality;
    use relief_volume::{Grid, Volume};

    /// Invariant: Of two presenters who change different settings at once, neither loses one.
    #[test]
    fn presenters_do_not_overwrite_each_others_settings() {
        let grid = Grid::axis_aligned([2, 2, 2], [1.0; 3], [0.0; 3]).unwrap();
        let volume = Volume::new(grid, vec![0; 8]).unwrap();
        let volumes = Volumes::within(1 << 20);
        let loaded =
            LoadedVolume { volume, warnings: Vec::new(), identity: None, reference: None, labels: None };
        volumes.add_own(loaded, None).unwrap();
        let presentation = Presentation::new(volumes.first().unwrap(), &Settings::default(), None).unwrap();
        let view = View::new("a".to_owned(), presentation, Instant::now());
        let put = |settings: Settings| view.configure(&settings, None, None, Instant::now()).unwrap();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for number in 1..=300 {
                    let quality = Some(Quality::Budget { budget_ms: f64::from(number) });
                    put(Settings { quality, ..Settings::default() });
                    let found = view.lock().presentation.quality;
                    assert_eq!(found, Quality::Budget { budget_ms: f64::from(number) });
                }
            });
            for number in 0..300 {
                let preset = ["bone", "skin"][number % 2];
                put(Settings { preset: Some(preset.to_owned()), ..Settings::default() });
                assert_eq!(view.lock().presentation.preset.as_deref(), Some(preset), "change {number}");
            }
        });
    }
}
