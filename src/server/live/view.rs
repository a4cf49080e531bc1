//! A view that several connections share: its state, who looks at it, and its newest picture.
//!
//! Messages change the state at once, under a short lock, in the order of their arrival: poses replace one another before anything is
//! rendered, and no intent is lost. The view's director (see `director`) takes the state whenever somebody has room for a picture.

mod ordering;

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use axum::http::StatusCode;
use serde_json::Value;
use tokio::sync::{Notify, watch};

use super::look::Look;
use super::motion::{Failure, Motion, Patience};
use super::order::{Next, Published};
use super::placing::method_of;
use super::preview::{Aim, Preview};
use super::shot::{Echo, Shot};
use super::slot::Slot;
use super::wished::{Carried, Ground, Happened, Wanted, Wished};
use crate::problem::Problem;
use crate::volumes::Entry;
use relief_annotation::{Method, Shown, Snap};
use relief_base::ViewDepth;
use relief_live::{
    ErrorMessage, Intent, IntentEffect, Peers, Role, Seen, ServerMessage, Settings, ViewRecord, ViewState,
};
use relief_session::Drawables;
use relief_volume::Camera;

/// See the module.
pub(super) struct View {
    pub(super) name: String,
    inner: Mutex<Inner>,
    /// Tells the director that something changed: the state, or somebody's room.
    pub(super) work: Notify,
    pub(super) shots: watch::Sender<Option<Arc<Shot>>>,
    /// The newest failure to render, as a message.
    pub(super) failures: watch::Sender<Option<Arc<str>>>,
    pub(super) peers: watch::Sender<Peers>,
    /// True once the volume was removed.
    pub(super) ended: watch::Sender<bool>,
}

struct Inner {
    look: Look,
    state: ViewState,
    /// A camera that was sent as such; any change by intents goes back to the state's own.
    camera: Option<Camera>,
    /// Counts everything that changes the picture.
    revision: u64,
    motion: Motion,
    slots: Vec<Arc<Slot>>,
    /// Since when nobody looks.
    idle_since: Instant,
    published: Option<Published>,
    /// Number of the newest picture ever.
    number: u64,
    /// How long the newest best picture of this look took to render.
    still_took: Option<Duration>,
    failed: Option<Failure>,
    /// How the cursor came to its place, last.
    method: Method,
    /// What goes with the cursor, while something is moved.
    carried: Option<Carried>,
    /// Where what is being placed would be set down.
    preview: Preview,
    /// Counts what is begun anew: other volumes, and other annotations that are drawn.
    era: u64,
    /// At which count of changes the annotations were read that are drawn; `None` where they have to be.
    drawn_at: Option<u64>,
}

impl View {
    pub(super) fn new(name: String, look: Look, now: Instant) -> Self {
        let mut state = ViewState::home(&look.stage);
        if let Some(name) = look.preset.clone() {
            // A step goes on from what is shown. The look has been made with it: there is one of this name.
            let _ = state.apply(&look.stage, 0, &Intent::Preset { name: Some(name), step: None }, None);
        }
        let inner = Inner {
            look,
            state,
            camera: None,
            revision: 1,
            motion: Motion::new(now),
            slots: Vec::new(),
            idle_since: now,
            published: None,
            number: 0,
            still_took: None,
            failed: None,
            method: Method::Tip,
            carried: None,
            preview: Preview::default(),
            era: 0,
            drawn_at: None,
        };
        Self {
            name,
            inner: Mutex::new(inner),
            work: Notify::new(),
            shots: watch::Sender::new(None),
            failures: watch::Sender::new(None),
            peers: watch::Sender::new(Peers { presenters: 0, watchers: 0 }),
            ended: watch::Sender::new(false),
        }
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        lock(&self.inner)
    }

    /// The volume that is shown.
    pub(super) fn entry(&self) -> Arc<Entry> {
        Arc::clone(&self.lock().look.entry)
    }

    /// The view as clients get it.
    pub(super) fn record(&self) -> ViewRecord {
        self.lock().record()
    }

    pub(super) fn revision(&self) -> u64 {
        self.lock().revision
    }

    pub(super) fn join(&self, slot: &Arc<Slot>) {
        self.lock().slots.push(Arc::clone(slot));
        self.count_peers();
        self.work.notify_one();
    }

    pub(super) fn leave(&self, slot: &Slot) {
        let mut inner = self.lock();
        inner.slots.retain(|known| known.id != slot.id);
        if inner.slots.is_empty() {
            inner.idle_since = Instant::now();
        }
        drop(inner);
        self.count_peers();
        self.work.notify_one();
    }

    fn count_peers(&self) {
        let inner = self.lock();
        let presenters = inner.slots.iter().filter(|slot| slot.role == Role::Presenter && !slot.is_plain);
        let presenters = presenters.count();
        let peers = Peers { presenters, watchers: inner.slots.len() - presenters };
        self.peers.send_if_modified(|known| std::mem::replace(known, peers) != peers);
    }

    /// Whether anybody looks.
    pub(super) fn is_watched(&self) -> bool {
        !self.lock().slots.is_empty()
    }

    /// Somebody is about to look: not to be forgotten now.
    pub(super) fn touch(&self) {
        self.lock().idle_since = Instant::now();
    }

    /// What landmarks are moved to as they are set down.
    pub(super) fn snap(&self) -> Option<Snap> {
        self.lock().look.snap
    }

    /// What goes with the cursor from now on, where the view still shows what it was taken from.
    pub(super) fn carry(&self, carried: Option<Carried>, era: u64, now: Instant) {
        let mut inner = self.lock();
        if era == inner.era && (carried.is_some() || inner.carried.is_some()) {
            inner.carried = carried;
            inner.changed(now);
        }
        drop(inner);
        self.work.notify_one();
    }

    /// Does something with the preview, which also gets what would be snapped now.
    pub(super) fn preview<T>(&self, act: impl FnOnce(&mut Preview, Option<Aim>) -> T) -> T {
        let mut inner = self.lock();
        let (aim, shown) = (inner.aim(), inner.preview.ghost());
        let outcome = act(&mut inner.preview, aim);
        if inner.preview.ghost() != shown {
            inner.revision += 1; // nobody moved: the view is as still as it was
            self.work.notify_one();
        }
        outcome
    }

    /// Whether nobody has looked for so long.
    pub(super) fn is_forgotten(&self, now: Instant, linger: Duration) -> bool {
        let inner = self.lock();
        inner.slots.is_empty() && now.saturating_duration_since(inner.idle_since) >= linger
    }

    /// The annotations that are drawn.
    pub(super) fn shown(&self) -> Shown {
        self.lock().look.shown.clone()
    }

    /// What wishes are made in now.
    pub(super) fn ground(&self) -> Ground {
        self.lock().ground()
    }

    /// The annotations that have to be read, where those that are drawn are not of this count of changes.
    pub(super) fn wanted(&self, changes: u64) -> Option<Wanted> {
        let inner = self.lock();
        let Look { entry, shown, shown_to, .. } = &inner.look;
        let is_due = !shown.is_nothing() && inner.drawn_at != Some(changes);
        is_due.then(|| Wanted { entry: Arc::clone(entry), shown: shown.clone(), author: shown_to.clone() })
    }

    /// Draws these from now on, if they are still what is wanted.
    pub(super) fn annotate(&self, wanted: &Wanted, drawables: Drawables, changes: u64, now: Instant) {
        let mut inner = self.lock();
        let Look { entry, shown, shown_to, .. } = &inner.look;
        if entry.id == wanted.entry.id && *shown == wanted.shown && *shown_to == wanted.author {
            inner.drawn_at = Some(changes);
            inner.look.set_drawables(drawables);
            inner.changed(now);
        }
    }

    /// Applies wishes, in their order, all or those before the first that is refused: what those did has happened all the same.
    pub(super) fn wish(
        &self,
        from: Option<(&Slot, Echo)>,
        intents: &[Intent],
        t_ns: u64,
        now: Instant,
    ) -> Wished {
        let seen = self.shots.borrow().clone();
        let mut inner = self.lock();
        // Under the lock: a picture shows a message and what it did, or neither.
        let unseen = from.is_some_and(|(slot, echo)| slot.heard(echo));
        let mut happened = Vec::new();
        let outcome = intents.iter().try_for_each(|intent| {
            happened.extend(inner.apply(intent, t_ns, seen.as_deref(), now)?);
            Ok(())
        });
        let ground = inner.ground();
        drop(inner);
        self.work.notify_one();
        Wished { unseen, happened, ground, refused: outcome.err() }
    }

    /// Shows what this camera sees. True where no picture showed the message before this one.
    pub(super) fn look_through(&self, (slot, echo): (&Slot, Echo), camera: Camera, now: Instant) -> bool {
        let mut inner = self.lock();
        let unseen = slot.heard(echo);
        if inner.camera != Some(camera) {
            inner.camera = Some(camera);
            inner.changed(now);
        }
        drop(inner);
        self.work.notify_one();
        unseen
    }

    /// Changes what is shown; `entry` is another volume. The work is done outside of the lock.
    ///
    /// # Errors
    /// Whatever is wrong with the settings; nothing has changed then.
    pub(super) fn settle(
        &self,
        settings: &Settings,
        entry: Option<Arc<Entry>>,
        author: Option<&str>,
        now: Instant,
    ) -> Result<(), Problem> {
        let before = self.lock().look.clone();
        let look = before.with(settings, entry, author)?;
        let mut inner = self.lock();
        // The same volume may have another label map by now.
        let is_other = look.entry.id != inner.look.entry.id;
        if is_other {
            inner.state = ViewState::home(&look.stage);
            inner.camera = None;
        }
        if is_other || (&look.shown, &look.shown_to) != (&inner.look.shown, &inner.look.shown_to) {
            // What is held is of what was there before: it stays where it was.
            inner.era += 1;
            inner.carried = None;
        }
        if is_other || settings.annotations.is_some() {
            inner.drawn_at = None;
        }
        let preset = look.preset.clone();
        inner.look = look;
        inner.preview.forget();
        inner.still_took = None;
        if let Some(name) = preset {
            let intent = Intent::Preset { name: Some(name), step: None };
            let Inner { state, look, .. } = &mut *inner;
            state.apply(&look.stage, 0, &intent, None).map_err(refused)?;
        }
        inner.changed(now);
        drop(inner);
        self.work.notify_one();
        Ok(())
    }

    /// What the director does next.
    pub(super) fn next(&self, now: Instant, patience: Patience) -> Next {
        self.lock().next(now, patience)
    }

    /// Makes a picture the newest.
    pub(super) fn publish(&self, shot: Arc<Shot>) {
        let Shot { number, revision, is_still, rendering, .. } = *shot;
        let mut inner = self.lock();
        if is_still && !rendering.is_zero() {
            inner.still_took = Some(rendering);
        }
        inner.published = Some(Published { number, revision, is_still });
        inner.number = number;
        drop(inner);
        self.shots.send_replace(Some(shot));
    }

    /// Tells everybody that a revision cannot be rendered, once. It is tried again where that may go well, and otherwise when
    /// something changes.
    pub(super) fn fail(&self, revision: u64, problem: &Problem, now: Instant) {
        let mut inner = self.lock();
        let failure = Failure::new(inner.failed, revision, problem.is_passing(), now);
        inner.failed = Some(failure);
        drop(inner);
        if failure.times == 1 {
            self.tell(problem);
        }
    }

    /// Tells everybody that something failed.
    pub(super) fn tell(&self, problem: &Problem) {
        let message = ErrorMessage { problem: problem.document(), fatal: false };
        self.failures.send_replace(Some(ServerMessage::Error(message).to_text().into()));
    }

    /// Lets the pictures go while nobody looks.
    pub(super) fn forget_pictures(&self) {
        self.lock().published = None;
        self.shots.send_replace(None);
    }
}

impl Inner {
    fn changed(&mut self, now: Instant) {
        self.motion.changed(now);
        self.revision += 1;
    }

    fn ground(&self) -> Ground {
        let Look { entry, shown, .. } = &self.look;
        Ground { entry: Arc::clone(entry), shown: shown.clone(), era: self.era }
    }

    fn record(&self) -> ViewRecord {
        let mut record = self.state.record();
        record.preset.clone_from(&self.look.preset);
        record.revision = self.revision;
        record
    }

    fn apply(
        &mut self,
        intent: &Intent,
        t_ns: u64,
        seen: Option<&Shot>,
        now: Instant,
    ) -> Result<Option<Happened>, Problem> {
        let annotates = !self.look.shown.is_nothing();
        if annotates && matches!(intent, Intent::Undo {}) {
            return Ok(Some(Happened::Undo)); // the view stays
        }
        let depth = |at: [f64; 2]| seen.map_or(ViewDepth::MISS, |shot| shot.depth_at(at));
        let seen = seen.map(|shot| Seen { camera: shot.frame.camera, depth: &depth });
        // What may be refused after the state has changed: a preset that the look cannot take.
        let may_choose = matches!(intent, Intent::Preset { .. } | Intent::Reset {} | Intent::Undo {});
        let before = may_choose.then(|| self.state.clone());
        let camera = self.camera;
        let applied = self.state.apply(&self.look.stage, t_ns, intent, seen.as_ref()).map_err(refused)?;
        self.method = method_of(intent, self.look.is_slice()).unwrap_or(self.method);
        if !self.state.is_placing() {
            self.preview.forget();
        }
        // A preset takes the place of a transfer function of one's own only where it was chosen, or comes back.
        let is_chosen = matches!(intent, Intent::Preset { .. } | Intent::Reset {})
            || before.as_ref().is_some_and(|before| self.state.preset() != before.preset());
        let is_other = is_chosen && self.state.preset() != self.look.preset.as_deref();
        if is_other {
            match self.look.with_preset(self.state.preset()) {
                Ok(look) => self.look = look,
                Err(problem) => {
                    if let Some(before) = before {
                        self.state = before;
                    }
                    return Err(problem);
                }
            }
        }
        if applied.changed || is_other {
            self.camera = None;
            self.changed(now);
        }
        let happened = match applied.event.filter(|_| annotates) {
            Some(IntentEffect::Placed(at)) => {
                let camera = self.look.seen_through(&self.state, camera)?;
                Some(Happened::Placed { at, camera, method: self.method })
            }
            Some(IntentEffect::Taking(at)) => {
                let reach_mm = self.state.reach_mm(&self.look.stage).map_err(refused)?;
                Some(Happened::Taking { at, reach_mm })
            }
            Some(IntentEffect::PlacingCancelled) => Some(Happened::Cancelled),
            Some(IntentEffect::NextLabel) => Some(Happened::NextLabel),
            _ => None,
        };
        Ok(happened)
    }

    /// What would be snapped if it were set down now.
    fn aim(&self) -> Option<Aim> {
        let snap = self.look.snap.filter(|_| self.state.is_placing() && !self.look.shown.is_nothing())?;
        let cursor = self.state.cursor()?;
        let at = match &self.carried {
            Some(Carried { off, from, .. }) => Some(cursor + *off).filter(|at| at != from)?,
            None => cursor,
        };
        let ray = match self.method {
            Method::Pick => Some(at - self.look.seen_through(&self.state, self.camera).ok()?.eye()),
            _ => None,
        };
        Some(Aim { entry: Arc::clone(&self.look.entry), at, ray, snap })
    }
}

pub(super) fn refused(error: impl std::fmt::Display) -> Problem {
    Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "refused-intent", error)
        .with("path", Value::from("intent"))
}

/// What is locked here is whole between statements, so a panic elsewhere leaves it usable.
pub(super) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
