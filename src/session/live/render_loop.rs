//! The render loop of a view: one task that renders its frames, one at a time, while a viewer has
//! capacity.
//!
//! A quick frame of a moving view is always finished, and the next one shows the newest state, so
//! fast motion cannot starve the viewers. A full-quality frame of a view at rest is cancelled as
//! soon as the view changes.

use std::error::Error;
use std::sync::Arc;
use std::time::{Duration, Instant};

use super::LiveError;
use super::effect::DrawablesWanted;
use super::frame::{Encodings, ViewFrame};
use super::job::{FrameJob, NextStep};
use super::outside::outside_depth;
use super::presentation::shrunk;
use super::steady_limits::Activity;
use super::view::View;
use super::views::Views;
use crate::engine::Engine;
use crate::{Drawables, Origin, Rendered, ServiceError, moving_detail};
use relief_live::{Quality, ServerMessage, StateMessage};
use relief_render::RenderRequest;

/// Delay before a full queue is tried again.
pub(super) const BUSY: Duration = Duration::from_millis(10);
/// Smallest side of a reduced frame.
const LEAST_PX: f64 = 32.0;

/// The source of the annotations that views draw.
pub trait DrawableSource: Send + Sync + 'static {
    /// A counter that rises with every change of an annotation.
    fn revision(&self) -> u64;

    /// Reads the annotations that a view draws.
    fn drawables(
        &self,
        wanted: &DrawablesWanted,
    ) -> impl Future<Output = Result<Drawables, Arc<dyn Error + Send + Sync>>> + Send;
}

/// Runs until the view has been abandoned or its volume was removed.
pub(super) async fn run(
    views: Arc<Views>,
    engine: Arc<Engine>,
    drawables: Option<Arc<impl DrawableSource>>,
    view: Arc<View>,
) {
    // Until this time, the view waited for the renderer or for a viewer.
    let mut blocked_until = Instant::now();
    let mut reading = None;
    loop {
        let due = view.play(|shown| engine.volumes.phases_of(shown), Instant::now());
        if due.is_some() {
            read_ahead(&engine, &view, &mut reading);
        }
        if let Some(source) = &drawables {
            annotate(&**source, &view).await;
        }
        match view.next(Instant::now(), views.patience) {
            NextStep::Render(job) => {
                make(&engine, &view, *job, blocked_until).await;
                blocked_until = Instant::now();
            }
            NextStep::Failed { revision, error } => view.fail(revision, error, Instant::now()),
            NextStep::Full => {
                view.work.notified().await;
                blocked_until = Instant::now();
            }
            NextStep::Idle(until) => {
                match until.into_iter().chain(due).min() {
                    None => view.work.notified().await,
                    Some(until) => {
                        let _ = tokio::time::timeout_at(until.into(), view.work.notified()).await;
                    }
                }
                if view.is_abandoned(Instant::now(), Duration::ZERO) {
                    view.drop_frames();
                }
            }
            NextStep::End => {
                if views.remove_abandoned(&view) {
                    return;
                }
            }
        }
        if !engine.volumes.has(&view.entry()) {
            view.ended.send_replace(true);
            views.remove(&view);
            return;
        }
    }
}

/// Reads the next phase while one is shown, where its voxels are not in memory. One read at a time.
fn read_ahead(engine: &Arc<Engine>, view: &View, reading: &mut Option<tokio::task::JoinHandle<()>>) {
    if reading.as_ref().is_some_and(|reading| !reading.is_finished()) {
        return;
    }
    let next = view.next_phase(|shown| engine.volumes.phases_of(shown));
    let Some(next) = next.filter(|next| !next.is_in_memory()) else { return };
    let engine = Arc::clone(engine);
    *reading = Some(tokio::spawn(async move {
        // The picture of that phase reports a failure.
        let _ = engine.voxels(&next).await;
    }));
}

/// Reads the annotations of a view again after they have changed.
async fn annotate(source: &impl DrawableSource, view: &View) {
    let revision = source.revision();
    let Some(wanted) = view.drawables_wanted(revision) else { return };
    match source.drawables(&wanted).await {
        Ok(drawables) => view.set_drawables(&wanted, drawables, revision, Instant::now()),
        Err(error) => {
            // Reported once, and retried after the next change.
            view.set_drawables(&wanted, Drawables::default(), revision, Instant::now());
            view.notify_failure(LiveError::Annotations(error));
        }
    }
}

/// Renders one frame and publishes it.
async fn make(engine: &Engine, view: &View, job: FrameJob, blocked_until: Instant) {
    let revision = job.revision;
    let rendered = match render(engine, view, &job).await {
        Ok(Some(rendered)) => rendered,
        Ok(None) => return,
        Err(error) => return view.fail(revision, error, Instant::now()),
    };
    let timings = rendered.frame.timings;
    let rendering = match rendered.origin {
        Origin::Reused => 0.0,
        Origin::Rendered => timings.upload_ms + timings.render_ms + timings.overlay_ms,
    };
    let rendering = Duration::from_secs_f64(rendering / 1e3);
    let waiting = if job.is_still {
        // A view at rest has waited since its last change, except for the time of rendering.
        job.arrived.elapsed().saturating_sub(rendering)
    } else {
        let queue = Duration::from_secs_f64(rendered.queue_ms.max(0.0) / 1e3);
        blocked_until.saturating_duration_since(job.arrived) + queue
    };
    match view_frame(view, &job, &rendered, rendering, waiting) {
        Ok(frame) => view.publish(Arc::new(frame), job.audience),
        Err(error) => view.fail(revision, error, Instant::now()),
    }
}

fn view_frame(
    view: &View,
    job: &FrameJob,
    rendered: &Rendered,
    rendering: Duration,
    waiting: Duration,
) -> Result<ViewFrame, LiveError> {
    let frame = Arc::clone(&rendered.frame);
    let limits = view.limits.lock().of(job.entry.region, &job.display, &frame, job.activity)?;
    let state = StateMessage { outside: outside_depth(&job.request, limits), ..job.state.clone() };
    Ok(ViewFrame {
        number: job.number,
        limits,
        request: job.request.clone(),
        entry: Arc::clone(&job.entry),
        frame,
        display: job.display.clone(),
        full_px: job.request.size_px,
        revision: job.revision,
        is_still: job.is_still,
        adapts: job.quality == Quality::Auto,
        arrived: job.arrived,
        rendering,
        waiting,
        shows: job.shows.clone(),
        state: ServerMessage::State(state).to_text().into(),
        encodings: Encodings::default(),
    })
}

/// Renders the picture of a job; `None` when a newer state replaced it, or the last viewer left.
async fn render(engine: &Engine, view: &View, job: &FrameJob) -> Result<Option<Rendered>, LiveError> {
    let request = if job.is_still { job.request.clone() } else { moving(engine, job) };
    let volume = engine.voxels(&job.entry).await?;
    let mut ticket = loop {
        match engine.service.render(&volume, request.clone()) {
            Ok(ticket) => break ticket,
            Err(ServiceError::Busy(_)) if !view.is_watched() => return Ok(None),
            Err(ServiceError::Busy(_)) => tokio::time::sleep(BUSY).await,
            Err(error) => return Err(error.into()),
        }
    };
    drop(volume);
    let outcome = loop {
        tokio::select! {
            outcome = &mut ticket => break outcome,
            () = view.work.notified() => {
                let is_replaced = job.is_still && view.revision() != job.revision;
                if is_replaced || !view.is_watched() {
                    return Ok(None); // dropping the ticket cancels it
                }
            }
        }
    };
    engine.observe(&outcome);
    Ok(Some(outcome?))
}

/// The request of a moving view, reduced to what the renderer and the presenters' connections have
/// time for.
fn moving(engine: &Engine, job: &FrameJob) -> RenderRequest {
    let mut request = job.request.clone().without_views_beside();
    // Shadows of lights that move with the eye would be computed again for every frame.
    request.illumination.shadows = 0.0;
    // A landmark is set down where the picture shows it: all voxels count then.
    if job.activity == Activity::Moving {
        request.detail = moving_detail(&request, &job.entry.grid);
    }
    let (service, hash, grid) = (&engine.service, job.entry.hash, &job.entry.grid);
    let planned = match job.quality {
        Quality::Auto => service.plan_moving(hash, grid, &request),
        Quality::Budget { budget_ms } => service.plan(hash, grid, &request, budget_ms),
    };
    let mut planned = planned.request;
    if job.keeps_size {
        return planned; // enlarged before overlays are drawn
    }
    let full = request.size_px;
    let share = if job.quality == Quality::Auto { job.share } else { 1.0 };
    let least = |side: u32| f64::from(side).min(LEAST_PX);
    let connection = full.map(|side| (f64::from(side) * share).max(least(side)).round() as u32);
    let size_px = planned.reduced_px.unwrap_or(full);
    let smaller = if size_px[1] <= connection[1] { size_px } else { connection };
    if smaller != full {
        planned = shrunk(planned, smaller);
    }
    planned
}
