//! A view that several viewers share: its state, its viewers and its newest frame.
//!
//! Messages change the state at once, under a short lock, in the order of their arrival. Poses
//! replace one another before a frame is rendered; no intent is lost. The view's render loop (see
//! `render_loop`) reads the state when a viewer has capacity for a frame.

mod configure;
mod ending;
pub(super) mod phases;
mod schedule;
mod viewers;

use std::sync::Arc;
use std::time::{Duration, Instant};

use parking_lot::{Mutex, MutexGuard};
use tokio::sync::{Notify, watch};

use super::LiveError;
use super::effect::{DrawablesWanted, EditContext, Effect, HeldPoint, Outcome};
use super::frame::{Echo, ViewFrame};
use super::job::{NextStep, Published};
use super::motion::{Delays, Failure, Motion};
use super::presentation::Presentation;
use super::preview::{Preview, SnapQuery};
use super::steady_limits::SteadyLimits;
use super::viewer::Viewer;
use crate::Drawables;
use crate::volumes::VolumeEntry;
use relief_annotation::{Method, ShownSets, Snap};
use relief_base::ViewDepth;
use relief_live::{DisplayedPicture, Eyes, Intent, IntentEffect, Peers, ViewRecord, ViewState};
use relief_volume::Camera;

/// A view and its channels to viewers.
pub struct View {
    /// The name is a key to the view: it appears in no log and no metric.
    pub name: String,
    inner: Mutex<Inner>,
    /// Those of the newest frame.
    pub(super) limits: Mutex<SteadyLimits>,
    /// Wakes the render loop: the state or the capacity of a viewer has changed.
    pub work: Notify,
    /// The newest frame.
    pub frames: watch::Sender<Option<Arc<ViewFrame>>>,
    /// The newest failure to render.
    pub failures: watch::Sender<Option<Arc<LiveError>>>,
    /// Numbers of viewers.
    pub peers: watch::Sender<Peers>,
    /// The eyes of a viewer, as a client sent them last.
    pub eyes: watch::Sender<Option<Eyes>>,
    /// True once the volume was removed.
    pub ended: watch::Sender<bool>,
}

impl std::fmt::Debug for View {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("View").finish_non_exhaustive() // without the name, which is a key
    }
}

struct Inner {
    presentation: Presentation,
    state: ViewState,
    /// A camera that a client sent. The next intent that changes the view returns to the camera of
    /// the state.
    camera: Option<Camera>,
    /// Counts the changes of the picture.
    revision: u64,
    motion: Motion,
    /// When it changed last other than by playing phases.
    moved: Instant,
    /// When the phase that is shown was due, while phases play.
    stepped: Instant,
    viewers: Vec<Arc<Viewer>>,
    /// When the last viewer left.
    idle_since: Instant,
    /// Whether it ever had a viewer: a session may come back to it.
    was_joined: bool,
    published: Option<Published>,
    /// Number of the newest frame.
    number: u64,
    /// Time of rendering of the newest full-quality frame.
    still_took: Option<Duration>,
    failed: Option<Failure>,
    /// How the cursor was moved last.
    method: Method,
    /// The point that follows the cursor.
    held: Option<HeldPoint>,
    /// The place to which the point that is being placed would snap.
    preview: Preview,
    /// See [`EditContext::epoch`].
    epoch: u64,
    /// Counts the changes of the presentation by settings.
    settings: u64,
    /// Revision of the annotations that are drawn; `None` when they have to be read.
    drawn_revision: Option<u64>,
    /// Rises when a viewer joins who may not see all annotations that the view draws. Frames of an earlier
    /// value are dropped.
    audience: u64,
}

impl View {
    /// A view in its home position.
    #[must_use]
    pub fn new(name: String, presentation: Presentation, now: Instant) -> Self {
        let mut state = ViewState::home(&presentation.stage);
        if let Some(name) = presentation.preset.clone() {
            // So that a step to the next preset starts here. The presentation has checked the name.
            let _ =
                state.apply(&presentation.stage, 0, &Intent::Preset { name: Some(name), step: None }, None);
        }
        let inner = Inner {
            presentation,
            state,
            camera: None,
            revision: 1,
            motion: Motion::new(now),
            moved: now,
            stepped: now,
            viewers: Vec::new(),
            idle_since: now,
            was_joined: false,
            published: None,
            number: 0,
            still_took: None,
            failed: None,
            method: Method::Tip,
            held: None,
            preview: Preview::default(),
            epoch: 0,
            settings: 0,
            drawn_revision: None,
            audience: 0,
        };
        Self {
            name,
            inner: Mutex::new(inner),
            limits: Mutex::default(),
            work: Notify::new(),
            frames: watch::Sender::new(None),
            failures: watch::Sender::new(None),
            peers: watch::Sender::new(Peers { presenters: 0, watchers: 0 }),
            eyes: watch::Sender::new(None),
            ended: watch::Sender::new(false),
        }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        self.inner.lock()
    }

    /// The volume that the view shows.
    #[must_use]
    pub fn entry(&self) -> Arc<VolumeEntry> {
        Arc::clone(&self.lock().presentation.entry)
    }

    /// The state of the view for clients.
    #[must_use]
    pub fn record(&self) -> ViewRecord {
        self.lock().record()
    }

    /// Counts the changes of the picture.
    #[must_use]
    pub fn revision(&self) -> u64 {
        self.lock().revision
    }

    /// Whether the view has a viewer.
    #[must_use]
    pub fn is_watched(&self) -> bool {
        !self.lock().viewers.is_empty()
    }

    /// Keeps the view for a viewer that is about to join.
    pub fn touch(&self) {
        self.lock().idle_since = Instant::now();
    }

    /// How landmarks snap when they are placed.
    #[must_use]
    pub fn snap(&self) -> Option<Snap> {
        self.lock().presentation.snap
    }

    /// Sets the point that follows the cursor, unless the view has entered another epoch.
    pub fn hold(&self, held: Option<HeldPoint>, epoch: u64, now: Instant) {
        let mut inner = self.lock();
        if epoch == inner.epoch && (held.is_some() || inner.held.is_some()) {
            inner.held = held;
            inner.changed(now);
        }
        drop(inner);
        self.work.notify_one();
    }

    /// Calls `act` with the preview and the aim of the cursor, and renders again if the preview has
    /// changed.
    pub(super) fn preview<T>(&self, act: impl FnOnce(&mut Preview, Option<SnapQuery>) -> T) -> T {
        let mut inner = self.lock();
        let (aim, shown) = (inner.aim(), inner.preview.ghost());
        let outcome = act(&mut inner.preview, aim);
        if inner.preview.ghost() != shown {
            inner.revision += 1; // not a motion: the view stays still
            self.work.notify_one();
        }
        outcome
    }

    /// Whether the view has had no viewer for `linger`.
    pub(super) fn is_abandoned(&self, now: Instant, linger: Duration) -> bool {
        let inner = self.lock();
        inner.viewers.is_empty() && now.saturating_duration_since(inner.idle_since) >= linger
    }

    /// The annotations that are drawn.
    #[must_use]
    pub fn shown(&self) -> ShownSets {
        self.lock().presentation.shown.clone()
    }

    /// The present content of the view.
    #[must_use]
    pub fn context(&self) -> EditContext {
        self.lock().context()
    }

    /// The annotations to read, unless those of this revision are drawn already.
    pub(super) fn drawables_wanted(&self, revision: u64) -> Option<DrawablesWanted> {
        let inner = self.lock();
        let Presentation { entry, shown, shown_to, .. } = &inner.presentation;
        let is_due = !shown.is_nothing() && inner.drawn_revision != Some(revision);
        is_due.then(|| DrawablesWanted {
            entry: Arc::clone(entry),
            shown: shown.clone(),
            author: shown_to.clone(),
            readers: inner.readers(),
        })
    }

    /// Draws these annotations, unless the view has changed its annotations meanwhile.
    pub(super) fn set_drawables(
        &self,
        wanted: &DrawablesWanted,
        drawables: Drawables,
        revision: u64,
        now: Instant,
    ) {
        let mut inner = self.lock();
        let Presentation { entry, shown, shown_to, .. } = &inner.presentation;
        let is_for_these = *shown_to == wanted.author && inner.readers() == wanted.readers;
        if entry.id == wanted.entry.id && *shown == wanted.shown && is_for_these {
            inner.drawn_revision = Some(revision);
            inner.presentation.set_drawables(drawables);
            inner.renewed(now);
        }
    }

    /// Applies intents in their order, up to the first that is refused. Those before it stay
    /// applied.
    pub fn apply_intents(
        &self,
        from: Option<(&Viewer, Echo)>,
        intents: &[Intent],
        t_ns: u64,
        now: Instant,
    ) -> Outcome {
        let seen = self.frames.borrow().clone();
        let mut inner = self.lock();
        // Under the lock: a frame shows a message and its changes, or neither.
        let replaced = from.is_some_and(|(viewer, echo)| viewer.received(echo));
        let mut effects = Vec::new();
        let result = intents.iter().try_for_each(|intent| {
            effects.extend(inner.apply(intent, t_ns, seen.as_deref(), now)?);
            Ok(())
        });
        let context = inner.context();
        drop(inner);
        self.work.notify_one();
        Outcome { replaced, effects, context, refused: result.err() }
    }

    /// Shows the volume through a camera that a client sent. True where no frame showed the
    /// viewer's previous message.
    pub fn set_camera(&self, viewer: &Viewer, echo: Echo, camera: Camera, now: Instant) -> bool {
        let mut inner = self.lock();
        let replaced = viewer.received(echo);
        if inner.camera != Some(camera) {
            inner.camera = Some(camera);
            inner.changed(now);
        }
        drop(inner);
        self.work.notify_one();
        replaced
    }

    /// The next step of the render loop.
    pub(super) fn next(&self, now: Instant, patience: Delays) -> NextStep {
        self.lock().next(now, patience)
    }

    /// Makes a frame the newest one. A frame of an earlier audience is dropped: it may show annotations
    /// that a new viewer may not see.
    pub(super) fn publish(&self, frame: Arc<ViewFrame>, audience: u64) {
        let ViewFrame { number, revision, is_still, rendering, .. } = *frame;
        let mut inner = self.lock();
        if inner.audience != audience {
            return;
        }
        if is_still && !rendering.is_zero() {
            inner.still_took = Some(rendering);
        }
        inner.published = Some(Published { number, revision, is_still });
        inner.number = number;
        self.frames.send_replace(Some(frame));
    }

    /// Records that a revision cannot be rendered, and notifies the viewers once. Temporary
    /// failures are retried; others wait for the next change.
    pub(super) fn fail(&self, revision: u64, error: LiveError, now: Instant) {
        let mut inner = self.lock();
        let failure = Failure::new(inner.failed, revision, error.is_temporary(), now);
        inner.failed = Some(failure);
        drop(inner);
        if failure.times == 1 {
            self.notify_failure(error);
        }
    }

    /// Sends an error to all viewers.
    pub(super) fn notify_failure(&self, error: LiveError) {
        if error.is_temporary() {
            tracing::error!(cause = &error as &dyn std::error::Error, "a live view could not be rendered");
        }
        self.failures.send_replace(Some(Arc::new(error)));
    }

    /// Drops the newest frame while the view has no viewer.
    pub(super) fn drop_frames(&self) {
        self.lock().published = None;
        self.frames.send_replace(None);
    }
}

impl Inner {
    fn changed(&mut self, now: Instant) {
        self.moved = now;
        self.renewed(now);
    }

    /// A change of the picture that nobody made by hand.
    fn renewed(&mut self, now: Instant) {
        self.motion.changed(now);
        self.revision += 1;
    }

    fn context(&self) -> EditContext {
        let Presentation { entry, shown, .. } = &self.presentation;
        EditContext { entry: Arc::clone(entry), shown: shown.clone(), epoch: self.epoch }
    }

    fn record(&self) -> ViewRecord {
        let mut record = self.state.record();
        record.preset.clone_from(&self.presentation.preset);
        record.revision = self.revision;
        record
    }

    fn apply(
        &mut self,
        intent: &Intent,
        t_ns: u64,
        seen: Option<&ViewFrame>,
        now: Instant,
    ) -> Result<Option<Effect>, LiveError> {
        let annotates = !self.presentation.shown.is_nothing();
        if annotates && matches!(intent, Intent::Undo {}) {
            return Ok(Some(Effect::Undo)); // the view stays
        }
        let depth = |at: [f64; 2]| seen.map_or(ViewDepth::MISS, |seen| seen.depth_at(at));
        let seen = seen.map(|seen| DisplayedPicture { camera: seen.frame.camera, depth: &depth });
        // The presentation may refuse a preset after the state has changed: then the state is
        // restored.
        let may_choose = matches!(intent, Intent::Preset { .. } | Intent::Reset {} | Intent::Undo {});
        let before = may_choose.then(|| self.state.clone());
        let camera = self.camera;
        let applied = self.state.apply(&self.presentation.stage, t_ns, intent, seen.as_ref())?;
        self.method = method_of(intent, self.presentation.is_slice()).unwrap_or(self.method);
        if !self.state.is_placing() {
            self.preview.forget();
        }
        // A preset replaces the scene's own transfer function only when an intent chose it or
        // restored it.
        let is_chosen = matches!(intent, Intent::Preset { .. } | Intent::Reset {})
            || before.as_ref().is_some_and(|before| self.state.preset() != before.preset());
        let is_other = is_chosen && self.state.preset() != self.presentation.preset.as_deref();
        if is_other {
            match self.presentation.with_preset(self.state.preset()) {
                Ok(presentation) => self.presentation = presentation,
                Err(error) => {
                    if let Some(before) = before {
                        self.state = before;
                    }
                    return Err(error);
                }
            }
        }
        if applied.changed || is_other {
            self.camera = None;
            self.changed(now);
        }
        let effect = match applied.event.filter(|_| annotates) {
            Some(IntentEffect::Placed(at)) => {
                let camera = self.presentation.seen_through(&self.state, camera)?;
                Some(Effect::Place { at, camera, method: self.method })
            }
            Some(IntentEffect::Taking(at)) => {
                let reach_mm = self.state.reach_mm(&self.presentation.stage)?;
                Some(Effect::Take { at, reach_mm })
            }
            Some(IntentEffect::PlacingCancelled) => Some(Effect::Cancel),
            Some(IntentEffect::NextLabel) => Some(Effect::NextLabel),
            _ => None,
        };
        Ok(effect)
    }

    /// The aim of the preview: what would snap if it were placed now.
    fn aim(&self) -> Option<SnapQuery> {
        let snap = self
            .presentation
            .snap
            .filter(|_| self.state.is_placing() && !self.presentation.shown.is_nothing())?;
        let cursor = self.state.cursor()?;
        let at = match &self.held {
            Some(HeldPoint { offset, from, .. }) => Some(cursor + *offset).filter(|at| at != from)?,
            None => cursor,
        };
        let ray = match self.method {
            Method::Pick => Some(at - self.presentation.seen_through(&self.state, self.camera).ok()?.eye()),
            _ => None,
        };
        Some(SnapQuery { entry: Arc::clone(&self.presentation.entry), at, ray, snap })
    }
}

/// How an intent moves the cursor; `None` for intents that leave it.
fn method_of(intent: &Intent, is_slice: bool) -> Option<Method> {
    match intent {
        Intent::Cursor { at_px: Some(_), .. } => Some(if is_slice { Method::Slice } else { Method::Pick }),
        Intent::Cursor { point_mm: Some(_), .. } => Some(Method::Typed),
        Intent::Cursor { .. } => Some(Method::Tip),
        _ => None,
    }
}
