//! The director of a view: one task that orders its pictures, one at a time, for whoever has room.
//!
//! While the view moves, a picture that was begun is finished: the next one shows the newest state, and no motion however quick starves
//! the frames. The large picture of a still view makes way as soon as something changes.

use std::sync::Arc;
use std::time::{Duration, Instant};

use super::look::shrunk;
use super::order::{Next, Order};
use super::shot::{Encodings, Shot};
use super::view::View;
use crate::problem::Problem;
use crate::resident::with_voxels;
use crate::state::Server;
use relief_live::Quality;
use relief_render::RenderRequest;
use relief_session::{Drawables, INTERACTIVE_MS, Origin, Rendered, ServiceError};

/// Before a full queue is asked again.
const BUSY: Duration = Duration::from_millis(10);
/// Least side of a picture that is made smaller.
const LEAST_PX: f64 = 32.0;

/// Runs until nobody has looked for long, or the volume is gone.
pub(super) async fn direct(server: Arc<Server>, view: Arc<View>) {
    let patience = server.live.patience();
    // Until then, waiting was for the renderer or for somebody's room.
    let mut blocked_until = Instant::now();
    loop {
        annotate(&server, &view).await;
        match view.next(Instant::now(), patience) {
            Next::Render(order) => {
                make(&server, &view, *order, blocked_until).await;
                blocked_until = Instant::now();
            }
            Next::Failed { revision, problem } => view.fail(revision, &problem, Instant::now()),
            Next::Full => {
                view.work.notified().await;
                blocked_until = Instant::now();
            }
            Next::Idle(None) => view.work.notified().await,
            Next::Idle(Some(until)) => {
                let _ = tokio::time::timeout_at(until.into(), view.work.notified()).await;
                if view.is_forgotten(Instant::now(), Duration::ZERO) {
                    view.forget_pictures();
                }
            }
            Next::End => {
                if server.live.remove_forgotten(&view) {
                    return;
                }
            }
        }
        if !server.volumes.has(&view.entry()) {
            view.ended.send_replace(true);
            server.live.remove(&view);
            return;
        }
    }
}

/// Reads the annotations anew that a view draws, where they have changed.
async fn annotate(server: &Server, view: &View) {
    let Some(annotations) = &server.annotations else { return };
    let changes = annotations.changes();
    let Some(wanted) = view.wanted(changes) else { return };
    match annotations.drawables(&wanted.entry, &wanted.shown, wanted.author.as_deref()).await {
        Ok(drawables) => view.annotate(&wanted, drawables, changes, Instant::now()),
        Err(problem) => {
            // Told once: tried again when something changes.
            view.annotate(&wanted, Drawables::default(), changes, Instant::now());
            view.tell(&problem);
        }
    }
}

/// Makes one picture and publishes it.
async fn make(server: &Arc<Server>, view: &View, order: Order, blocked_until: Instant) {
    let revision = order.revision;
    match render(server, view, &order).await {
        Ok(Some(rendered)) => {
            let timings = rendered.frame.timings;
            let rendering = match rendered.origin {
                Origin::Reused => 0.0,
                Origin::Rendered => timings.upload_ms + timings.render_ms + timings.overlay_ms,
            };
            let rendering = Duration::from_secs_f64(rendering / 1e3);
            let waiting = if order.is_still {
                // A still view has waited since its last change, but for the time of rendering.
                order.arrived.elapsed().saturating_sub(rendering)
            } else {
                let queue = Duration::from_secs_f64(rendered.queue_ms.max(0.0) / 1e3);
                blocked_until.saturating_duration_since(order.arrived) + queue
            };
            match shot(&order, &rendered, rendering, waiting) {
                Ok(shot) => view.publish(Arc::new(shot)),
                Err(problem) => view.fail(revision, &problem, Instant::now()),
            }
        }
        Ok(None) => {}
        Err(problem) => view.fail(revision, &problem, Instant::now()),
    }
}

fn shot(order: &Order, rendered: &Rendered, rendering: Duration, waiting: Duration) -> Result<Shot, Problem> {
    let frame = Arc::clone(&rendered.frame);
    Ok(Shot {
        number: order.number,
        limits: order.display.limits(frame.limits)?,
        frame,
        display: order.display.clone(),
        full_px: order.request.size_px,
        revision: order.revision,
        is_still: order.is_still,
        adapts: order.quality == Quality::Auto,
        arrived: order.arrived,
        rendering,
        waiting,
        shows: order.shows.clone(),
        state: Arc::clone(&order.state),
        encodings: Encodings::default(),
    })
}

/// The picture; `None` where it made way for a newer one, or nobody looks any more.
async fn render(server: &Arc<Server>, view: &View, order: &Order) -> Result<Option<Rendered>, Problem> {
    let request = if order.is_still { order.request.clone() } else { moving(server, order) };
    let volume = with_voxels(server, &order.entry).await?;
    let mut ticket = loop {
        match server.service.render(&volume, request.clone()) {
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
                let is_overtaken = order.is_still && view.revision() != order.revision;
                if is_overtaken || !view.is_watched() {
                    return Ok(None); // dropping the ticket ends it
                }
            }
        }
    };
    server.metrics.rendered(&outcome);
    Ok(Some(outcome?))
}

/// The request while the view moves: as much of it as the renderer and the presenters' connections have time for.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a share of a picture's side")]
fn moving(server: &Server, order: &Order) -> RenderRequest {
    let mut request = order.request.clone();
    // Shadows of lights that go with the eye would be filled anew for every picture.
    request.illumination.shadows = 0.0;
    let budget_ms = match order.quality {
        Quality::Auto => INTERACTIVE_MS,
        Quality::Budget { budget_ms } => budget_ms,
    };
    let mut planned = server.service.plan(order.entry.hash, &order.entry.grid, &request, budget_ms).request;
    if order.keeps_size {
        return planned; // enlarged before overlays are drawn
    }
    let full = request.size_px;
    let share = if order.quality == Quality::Auto { order.share } else { 1.0 };
    let least = |side: u32| f64::from(side).min(LEAST_PX);
    let connection = full.map(|side| (f64::from(side) * share).max(least(side)).round() as u32);
    let size_px = planned.reduced_px.unwrap_or(full);
    let smaller = if size_px[1] <= connection[1] { size_px } else { connection };
    if smaller != full {
        planned = shrunk(planned, smaller);
    }
    planned
}
