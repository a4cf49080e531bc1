//! `relief client`: the thin client of a display box.

pub(crate) mod arguments;
mod eyes;
mod film;
mod pointer;
mod remote;
mod replay;
mod session;
mod watch;
#[cfg(feature = "window")]
mod window;

use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, bail};

use crate::output::{print_json, say, write_whole};
use crate::stop::stop_signal;
use arguments::ClientArguments;
use relief_client::{ClientError, Handle};
use relief_display::{Layout, encode_png};
use session::Session;
use watch::{FrameCounter, Recorder};

pub(super) fn run(arguments: &ClientArguments) -> anyhow::Result<ExitCode> {
    let session = Session::of(arguments)?;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let outcome = match (&arguments.replay, arguments.headless.measure) {
        (Some(path), _) => runtime.block_on(replay::run(arguments.json, path, &session)),
        (None, Some(seconds)) => runtime.block_on(run_measure(arguments, &session, seconds)),
        (None, None) => run_session(arguments, &session, &runtime),
    };
    // A name that is being looked up is not waited for.
    runtime.shutdown_timeout(Duration::from_millis(500));
    outcome
}

/// Everything but measuring and replaying: shows, saves, relays, records.
fn run_session(
    arguments: &ClientArguments,
    session: &Session,
    runtime: &tokio::runtime::Runtime,
) -> anyhow::Result<ExitCode> {
    let handle = Handle::new();
    let recorder = Recorder::create(&arguments.recording, session)?;
    let remote = remote::start(&arguments.remote, &handle)?;
    pointer::start(&arguments.pointer, &handle)?;
    #[cfg(feature = "window")]
    if !arguments.headless.headless {
        window::run(arguments, session, &handle, remote, recorder, runtime)?;
        return Ok(ExitCode::SUCCESS);
    }
    #[cfg(not(feature = "window"))]
    if !arguments.headless.headless {
        bail!("{}; --headless works without it", crate::features::lacks("the window", "window"));
    }
    drop(remote);
    eyes::start(&arguments.eyes, &handle, Box::new(|_| ()))?;
    let has_output = arguments.headless.save_frame.is_some() || arguments.recording.record.is_some();
    let has_input = arguments.remote.is_there() || arguments.eyes.is_there() || arguments.pointer.is_there();
    if !has_output && !has_input {
        eprintln!(
            "keeping a session open until Ctrl-C; --save-frame, --record, --wiimote, --pointer and --eyes give it something to do"
        );
    }
    let watch = FrameCounter::new(&handle, &recorder);
    let save = arguments.headless.save_frame.as_deref();
    let outcome = runtime.block_on(async {
        let signal = stop_signal()?;
        let on = |event| watch.take(event);
        let link = relief_client::run(&session.options, &handle, &on);
        let work = async {
            let seq = watch.look(arguments.look).await;
            if save.is_none() {
                std::future::pending::<()>().await; // relays and records until a signal stops it
            }
            tokio::time::timeout(STILL, watch.still_after(seq)).await
        };
        anyhow::Ok(finished(link, work, signal, &handle).await?)
    });
    recorder.finish()?;
    let still =
        outcome?.transpose().with_context(|| format!("no still frame within {} s", STILL.as_secs()))?;
    if let (Some(path), Some(still)) = (save, still) {
        let composed = session.composer.compose(&still).context("the frame cannot be composed")?;
        save_frame(path, &composed)?;
        report_saved(arguments, path, &still, composed.layout)?;
    }
    Ok(ExitCode::SUCCESS)
}

/// Runs a session until its work is done, it fails or a signal stops it; closes it properly.
async fn finished<T>(
    link: impl Future<Output = Result<(), ClientError>>,
    work: impl Future<Output = T>,
    signal: impl Future<Output = ()>,
    handle: &Handle,
) -> Result<Option<T>, ClientError> {
    tokio::pin!(link, work, signal);
    let worked = tokio::select! {
        ended = &mut link => return ended.map(|()| None),
        worked = &mut work => Some(worked),
        () = &mut signal => None,
    };
    handle.stop();
    link.await.map(|()| worked)
}

/// The longest time of a still frame: the volume may have to be loaded, and a large one rendered.
const STILL: Duration = Duration::from_secs(120);

fn report_saved(
    arguments: &ClientArguments,
    path: &std::path::Path,
    still: &relief_client::Received,
    layout: Layout,
) -> anyhow::Result<()> {
    let header = &still.header;
    if arguments.json {
        return print_json(&serde_json::json!({
            "out": path,
            "full_px": header.full_px,
            "lossless": header.lossless(),
            "layout": layout,
            "near_mm": header.limits_mm[0],
            "far_mm": header.limits_mm[1],
            "bytes": still.bytes.len(),
        }));
    }
    say!("Wrote {}: layout {} of {}x{}.", path.display(), layout, header.full_px[0], header.full_px[1]);
    Ok(())
}

pub(super) fn save_frame(path: &std::path::Path, composed: &relief_client::Composed) -> anyhow::Result<()> {
    if let Some(problem) = &composed.header_problem {
        bail!("the frame's header row differs from the requested one: {problem}");
    }
    write_whole(path, &encode_png(&composed.frame)?)
}

async fn run_measure(
    arguments: &ClientArguments,
    session: &Session,
    seconds: f64,
) -> anyhow::Result<ExitCode> {
    let headless = &arguments.headless;
    let plan = relief_client::MeasurePlan {
        options: session.options.clone(),
        seconds,
        pose_hz: f64::from(headless.pose_hz),
        clients: headless.clients.into(),
        stalled: headless.stalled.into(),
        check_every: headless.check_every,
        composer: session.composer.clone(),
    };
    let signal = stop_signal()?;
    let (report, last) = tokio::select! {
        measured = relief_client::measure(&plan) => measured?,
        () = signal => bail!("stopped before all was measured"),
    };
    if let Some(path) = &headless.save_frame {
        let last = last.context("no frame was composed that could be saved")?;
        save_frame(path, &last)?;
    }
    if arguments.json {
        print_json(&report)?;
    } else {
        tell(&report);
    }
    Ok(if report.bad_headers + report.malformed + report.unreadable == 0 {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}

fn tell(report: &relief_client::MeasureReport) {
    let ms = |value: Option<f64>| value.map_or_else(|| "-".to_owned(), |ms| format!("{ms:.1} ms"));
    say!(
        "{:.1} frames/s for each of {} clients ({:.1} to {:.1}), {} stalled beside them, {:.1} s",
        report.frames_per_s,
        report.clients,
        report.frames_per_s_min,
        report.frames_per_s_max,
        report.stalled,
        report.seconds
    );
    say!("overhead:      {} (99 %: {})", ms(report.overhead_ms_p50), ms(report.overhead_ms_p99));
    say!("pose to frame: {} (99 %: {})", ms(report.pose_to_frame_ms_p50), ms(report.pose_to_frame_ms_p99));
    say!("still frame:   {} after the last pose", ms(report.still_ms));
    say!("bytes a frame: {:.0}", report.bytes_per_frame.unwrap_or(0.0));
    say!(
        "{} header rows read back, {} wrong; {} frames malformed; {} reconnects",
        report.checked,
        report.bad_headers,
        report.malformed,
        report.reconnects
    );
}
