//! Measures the latency and rate of a server from its clients.
//!
//! Each client turns its view about the patient with [`MeasurePlan::pose_hz`] poses per second,
//! then keeps still until the lossless frame arrives. Clients of a shared view watch while the
//! first one turns it. Stalled clients add load: some read nothing from their connection, others
//! acknowledge nothing.
//!
//! All times are of this machine's clock: a frame echoes the time of the pose that it shows.

mod meter;
mod report;
mod stalled;

use std::sync::Arc;
use std::time::Duration;

use tokio::task::{JoinError, JoinSet};
use tokio::time::{MissedTickBehavior, interval, sleep, timeout};

use super::address::ServerAddress;
use super::compose::{Composed, Composer};
use super::error::{ClientError, LossError};
use super::handle::Handle;
use super::link;
use meter::Meter;
use relief_live::{Hello, OrbitPose, PoseKind, Role};

pub use report::MeasureReport;

/// The longest time of a first frame: a volume may have to be prepared.
const FIRST_FRAME: Duration = Duration::from_secs(60);
/// The longest time of the still frame.
const STILL: Duration = Duration::from_secs(30);

/// The settings of a measurement.
#[derive(Clone, Debug)]
pub struct MeasurePlan {
    /// Server and session; where its view has a name, all clients share that.
    pub options: link::Options,
    /// The time for which the view moves, seconds.
    pub seconds: f64,
    /// Poses a second.
    pub pose_hz: f64,
    /// Clients that take and acknowledge their frames.
    pub clients: usize,
    /// Clients that do not.
    pub stalled: usize,
    /// Interval of frames that are composed and whose header is checked; 0 for none.
    pub check_every: u32,
    /// The composer of frames.
    pub composer: Composer,
}

/// Measures; gives the report and the last frame of the first client, where it was composed.
///
/// # Errors
/// When a client gets no session or no frame, or loses it for good.
pub async fn measure(plan: &MeasurePlan) -> Result<(MeasureReport, Option<Composed>), ClientError> {
    let stop_stalled = Handle::new();
    let mut stalled = JoinSet::new();
    for at in 0..plan.stalled {
        let (hello, options) = (hello_of(plan, plan.clients + at), plan.options.clone());
        stalled.spawn(stalled::stall(options.server, options.access, hello, at, stop_stalled.clone()));
    }
    let mut running = JoinSet::new();
    let start = Arc::new(tokio::sync::Barrier::new(plan.clients.max(1)));
    let mut meters = Vec::new();
    for at in 0..plan.clients.max(1) {
        let meter = Arc::new(Meter::new(plan.composer.clone(), plan.check_every));
        meters.push(Arc::clone(&meter));
        let options = link::Options { hello: hello_of(plan, at), ..plan.options.clone() };
        let (moves, start) = (moves(plan, at), Arc::clone(&start));
        let [seconds, pose_hz] = [plan.seconds, plan.pose_hz];
        let server = plan.options.server.clone();
        running.spawn(async move {
            // A separate task: composing a frame does not delay poses.
            let taking = Arc::clone(&meter);
            let mut link = JoinSet::new();
            link.spawn(
                async move { link::run(&options, taking.handle(), &|event| taking.take(event)).await },
            );
            let client = Client { meter: &meter, server: &server, seconds, pose_hz, moves };
            let outcome = tokio::select! {
                Some(ended) = link.join_next() => return flat(&server, ended),
                outcome = client.run(&start) => outcome,
            };
            meter.handle().stop();
            let ended = link.join_next().await.map_or(Ok(()), |ended| flat(&server, ended));
            outcome.and(ended)
        });
    }
    while let Some(outcome) = running.join_next().await {
        // The others wait for one another: without this one they would for ever.
        flat(&plan.options.server, outcome)?;
    }
    stop_stalled.stop();
    let mut burden = stalled::StalledLoad::default();
    while let Some(outcome) = stalled.join_next().await {
        burden = burden.with(flat(&plan.options.server, outcome.map(Ok))?);
    }
    let last = meters.first().and_then(|meter| meter.take_last());
    Ok((MeasureReport::of(plan, &meters, burden), last))
}

/// The outcome of a task. A task that panicked counts as a lost client.
fn flat<T>(
    server: &ServerAddress,
    outcome: Result<Result<T, ClientError>, JoinError>,
) -> Result<T, ClientError> {
    outcome.unwrap_or_else(|error| Err(ClientError::Lost { server: server.clone(), source: error.into() }))
}

/// Whether a client turns the view: its own, or the shared one where it is the first.
fn moves(plan: &MeasurePlan, at: usize) -> bool {
    let hello = &plan.options.hello;
    hello.role == Role::Presenter && (hello.view.is_none() || at == 0)
}

fn hello_of(plan: &MeasurePlan, at: usize) -> Hello {
    let hello = plan.options.hello.clone();
    let shares = hello.view.is_some() && at > 0;
    // Watchers cannot change settings; the first client has.
    if shares { Hello { role: Role::Watcher, settings: None, ..hello } } else { hello }
}

/// Position of the eye after this many seconds of turning: 30 degrees per second, rising and
/// falling.
pub(super) fn turned(seconds: f64) -> PoseKind {
    PoseKind::Orbit(OrbitPose {
        azimuth_deg: (20.0 + 30.0 * seconds) % 360.0,
        elevation_deg: 10.0 + 15.0 * seconds.sin(),
        zoom: None,
    })
}

struct Client<'a> {
    meter: &'a Meter,
    server: &'a ServerAddress,
    seconds: f64,
    pose_hz: f64,
    moves: bool,
}

impl Client<'_> {
    async fn run(&self, start: &tokio::sync::Barrier) -> Result<(), ClientError> {
        let first = timeout(FIRST_FRAME, self.meter.first_frame()).await;
        first.map_err(|_| {
            let source = LossError::NoFrame(FIRST_FRAME);
            ClientError::Lost { server: self.server.clone(), source }
        })?;
        start.wait().await;
        self.meter.begin();
        let length = Duration::from_secs_f64(self.seconds);
        if self.moves {
            let _ = timeout(length, self.turn()).await; // turning has no end of its own
        } else {
            sleep(length).await;
        }
        self.meter.end();
        if self.moves {
            // Without one the report has none.
            let _ = timeout(STILL, self.meter.still_frame()).await;
        }
        Ok(())
    }

    async fn turn(&self) {
        let handle = self.meter.handle();
        let start = handle.now_ns();
        let mut ticks = interval(Duration::from_secs_f64(1.0 / self.pose_hz));
        ticks.set_missed_tick_behavior(MissedTickBehavior::Skip);
        loop {
            ticks.tick().await;
            let now = handle.now_ns();
            let seq = handle.pose(now, turned((now - start) as f64 * 1e-9));
            self.meter.posed(seq, now);
        }
    }
}
