//! `relief client`: the thin client of a display box.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use anyhow::{Context, bail};

use super::choices::layouts;
use super::client_remote::{self, RemoteArguments};
use super::client_session::{Part, Session};
use super::client_watch::{FrameCounter, Recorder};
use super::output::{print_json, say, write_whole};
use super::scene::parse_size;
use super::serve::stop_signal;
use relief_annotation::ShownSets;
use relief_client::{ClientError, Handle, ServerAddress};
use relief_display::{Layout, encode_png};
use relief_live::{LiveLayout, OrbitPose, check_view_name};

/// Show the frames of a live session on this machine's display, pixel for pixel, and send it the
/// Wiimote's poses.
#[derive(Debug, clap::Args)]
#[command(after_help = AFTER_HELP)]
pub(super) struct ClientArguments {
    /// The server: http://HOST:PORT or ws://HOST:PORT
    #[arg(long, value_name = "URL")]
    pub(super) server: ServerAddress,
    /// Name of a view that several clients share; one of its own when left out
    #[arg(long, value_name = "NAME", value_parser = view_name)]
    pub(super) view: Option<String>,
    /// Volume, by its id; the first one when left out
    #[arg(long, value_name = "ID")]
    pub(super) volume: Option<String>,
    /// Whether this client may move the view, or looks
    #[arg(long, value_enum, default_value_t = Part::Presenter)]
    pub(super) role: Part,
    /// Preset of colours and light
    #[arg(long, value_name = "NAME")]
    pub(super) preset: Option<String>,
    /// Look from there: azimuth and elevation, degrees, and zoom if you like
    #[arg(long, value_name = "AZ,EL[,ZOOM]", value_parser = parse_look, allow_hyphen_values = true)]
    pub(super) look: Option<OrbitPose>,
    #[arg(long, value_name = "NAME", help = layouts("Layout of the frame", is_streamed))]
    pub(super) layout: Option<Layout>,
    /// Depth effect that the display's header asks for; 64 is 100 %
    #[arg(long, value_name = "0..255")]
    pub(super) factor: Option<u8>,
    /// Disparity on the screen plane that the display's header asks for
    #[arg(long, value_name = "0..255")]
    pub(super) offset: Option<u8>,
    /// Size of the picture (in 2D-plus-depth layouts, of each half)
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub(super) size: Option<[u32; 2]>,
    /// Lossless colour while the view moves, too
    #[arg(long)]
    pub(super) lossless: bool,
    /// Draw annotations: all, or sets by their names with commas between them; A places landmarks
    /// then, and 1 takes them back
    #[arg(long, value_name = "true|SETS", value_parser = ShownSets::parse)]
    pub(super) annotations: Option<ShownSets>,
    /// Author of placed annotations
    #[arg(long, value_name = "NAME", env = "RELIEF_AUTHOR")]
    pub(super) author: Option<String>,
    /// Wait for a server that is not there yet
    #[arg(long)]
    pub(super) wait: bool,
    #[command(flatten)]
    pub(super) remote: RemoteArguments,
    #[command(flatten)]
    headless: HeadlessArguments,
    /// Record the session: messages and hashes of frames, JSON lines
    #[arg(long, value_name = "FILE", conflicts_with = "measure")]
    record: Option<PathBuf>,
    /// Play a recorded session, and compare its still pictures
    #[arg(long, value_name = "FILE", conflicts_with_all = ["measure", "look"])]
    replay: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
    #[cfg(feature = "window")]
    #[command(flatten)]
    window: super::client_window::WindowArguments,
}

#[derive(Debug, clap::Args)]
struct HeadlessArguments {
    /// Open no window
    #[arg(long)]
    headless: bool,
    /// Move the view for so long, and tell how quick the server is
    #[arg(long, value_name = "SECONDS", requires = "headless", value_parser = seconds)]
    measure: Option<f64>,
    /// Clients that measure; with --view they share one that the first of them moves
    #[arg(long, value_name = "N", requires = "measure", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1000))]
    clients: u16,
    /// Clients beside them that take nothing, or acknowledge nothing
    #[arg(long, value_name = "M", requires = "measure", default_value_t = 0, value_parser = clap::value_parser!(u16).range(0..=1000))]
    stalled: u16,
    /// Poses a second
    #[arg(long, value_name = "HZ", requires = "measure", default_value_t = 60, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pose_hz: u16,
    /// Compose every N-th frame and check its header; 0 checks the still frame only
    #[arg(long, value_name = "N", requires = "measure", default_value_t = 1)]
    check_every: u32,
    /// Write the still frame, composed, as PNG
    #[arg(long, value_name = "F.png", requires = "headless")]
    save_frame: Option<PathBuf>,
}

const AFTER_HELP: &str = "\
Without --headless a window shows the frames, one pixel of a frame on one pixel of the display. A lost connection is made again,
and the session goes on where it was.

Mouse: drag turns, right drag shifts, the wheel zooms, Ctrl and click sets the cursor.
Keys: arrows turn, + and - zoom, [ and ] change the preset, Page Up and Page Down cut, space places, U takes back, N next label,
      R resets, F full screen, Q or Escape ends.

Examples:
  relief client --server http://ct-server:8080 --fullscreen --wiimote hidraw --view theatre-1
  relief client --server http://127.0.0.1:8080 --headless --look 30,10 --save-frame frame.png
  relief client --server http://127.0.0.1:8080 --headless --measure 10 --json
  relief client --server http://127.0.0.1:8080 --headless --measure 600 --clients 50 --stalled 50 --view soak --check-every 0";

fn view_name(name: &str) -> Result<String, String> {
    check_view_name(name).map(|()| name.to_owned()).map_err(|error| error.reason)
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|error| format!("{error}"))?;
    if (0.1..=3600.0).contains(&seconds) { Ok(seconds) } else { Err("allowed: 0.1 to 3600 s".to_owned()) }
}

fn parse_look(text: &str) -> Result<OrbitPose, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse::<f64>()).collect();
    match numbers.as_deref() {
        Ok(&[azimuth_deg, elevation_deg]) => Ok(OrbitPose { azimuth_deg, elevation_deg, zoom: None }),
        Ok(&[azimuth_deg, elevation_deg, zoom]) => {
            Ok(OrbitPose { azimuth_deg, elevation_deg, zoom: Some(zoom) })
        }
        _ => Err("a view is AZIMUTH,ELEVATION or AZIMUTH,ELEVATION,ZOOM, such as 30,10,1.4".to_owned()),
    }
}

pub(super) fn run(arguments: &ClientArguments) -> anyhow::Result<ExitCode> {
    let session = Session::of(arguments)?;
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let outcome = match (&arguments.replay, arguments.headless.measure) {
        (Some(path), _) => runtime.block_on(super::client_replay::run(arguments.json, path, &session)),
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
    let recorder = Recorder::create(arguments.record.as_deref(), &session.options.hello)?;
    let remote = client_remote::start(&arguments.remote, &handle)?;
    #[cfg(feature = "window")]
    if !arguments.headless.headless {
        let hands = (&handle, remote, arguments.look);
        super::client_window::run(&arguments.window, session, hands, recorder, runtime)?;
        return Ok(ExitCode::SUCCESS);
    }
    #[cfg(not(feature = "window"))]
    if !arguments.headless.headless {
        bail!("this program was built without its window (feature window); --headless works without one");
    }
    drop(remote);
    let watch = FrameCounter::new(&handle, &recorder);
    let save = arguments.headless.save_frame.as_deref();
    let outcome = runtime.block_on(async {
        let signal = stop_signal()?;
        let on = |event| watch.take(event);
        let link = relief_client::run(&session.options, &handle, &on);
        let work = async {
            let seq = watch.look(arguments.look).await;
            if save.is_none() {
                std::future::pending::<()>().await; // relays and records until it is told to stop
            }
            tokio::time::timeout(STILL, watch.still_after(seq)).await
        };
        anyhow::Ok(finished(link, work, signal, &handle).await?)
    });
    recorder.finish()?;
    let still =
        outcome?.transpose().with_context(|| format!("no still frame within {} s", STILL.as_secs()))?;
    if let (Some(path), Some(still)) = (save, still) {
        save_frame(path, &session.composer.compose(&still).context("the frame cannot be composed")?)?;
        report_saved(arguments, path, &still)?;
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

/// How long a still frame may take: the volume may have to be loaded, and a large one rendered.
const STILL: Duration = Duration::from_secs(120);

fn report_saved(
    arguments: &ClientArguments,
    path: &std::path::Path,
    still: &relief_client::Received,
) -> anyhow::Result<()> {
    let header = &still.header;
    if arguments.json {
        return print_json(&serde_json::json!({
            "out": path,
            "full_px": header.full_px,
            "lossless": header.lossless(),
            "layout": header.layout.name(),
            "near_mm": header.limits_mm[0],
            "far_mm": header.limits_mm[1],
            "bytes": still.bytes.len(),
        }));
    }
    say!(
        "Wrote {}: layout {} of {}x{}.",
        path.display(),
        header.layout.name(),
        header.full_px[0],
        header.full_px[1]
    );
    Ok(())
}

pub(super) fn save_frame(path: &std::path::Path, composed: &relief_client::Composed) -> anyhow::Result<()> {
    if let Some(problem) = &composed.header_problem {
        bail!("the frame's header row is not what was asked for: {problem}");
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

/// Whether live sessions have this layout.
fn is_streamed(layout: Layout) -> bool {
    LiveLayout::of(layout) != LiveLayout::None
}
