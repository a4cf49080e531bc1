//! `relief client --replay`: a recorded session once more, and whether it ends in the same
//! pictures.

use std::io::BufReader;
use std::path::Path;
use std::process::ExitCode;
use std::time::{Duration, Instant};

use anyhow::Context;

use crate::client::session::Session;
use crate::client::watch::{FrameCounter, Recorder};
use crate::output::{print_json, say};
use relief_client::{Handle, Journal, JournalEntry, Options};
use relief_live::{ClientMessage, Hello};

/// The longest time of the last still frame.
const STILL: Duration = Duration::from_secs(60);

/// The outcome of a replay.
#[derive(serde::Serialize)]
struct ReplayOutcome {
    messages: u64,
    dropped: u64,
    seconds: f64,
    recorded_pixels_sha256: Option<String>,
    pixels_sha256: Option<String>,
    same: Option<bool>,
}

type Recorded = Journal<BufReader<std::fs::File>>;

pub(crate) async fn run(json: bool, path: &Path, session: &Session) -> anyhow::Result<ExitCode> {
    let is_session = || format!("{} is no recorded session", path.display());
    let file = std::fs::File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
    let recorded = Journal::open(BufReader::new(file)).with_context(is_session)?;
    // A private view unless the arguments name one, so that a replay does not disturb other
    // viewers.
    let asked = &session.options.hello;
    let was = recorded.hello().clone();
    let hello = Hello {
        volume: asked.volume.clone().or(was.volume),
        settings: asked.settings.clone().or(was.settings),
        size_px: asked.size_px.or(was.size_px),
        ..asked.clone()
    };
    let options = Options { hello, ..session.options.clone() };
    let handle = Handle::new();
    let recorder = Recorder::none();
    let watch = FrameCounter::new(&handle, &recorder);
    let on = |event| watch.take(event);
    let link = relief_client::run(&options, &handle, &on);
    let play = async {
        let played = play(recorded, &handle, &watch).await;
        handle.stop();
        played
    };
    let (linked, played) = tokio::join!(link, play);
    linked?;
    let outcome = played.with_context(is_session)?;
    let same = outcome.same;
    if json {
        print_json(&outcome)?;
    } else {
        say!("{} messages in {:.1} s, {} dropped", outcome.messages, outcome.seconds, outcome.dropped);
        say!(
            "the last still picture is {}",
            match same {
                Some(true) => "the recorded one",
                Some(false) => "another one than was recorded",
                None => "missing here or in the recording",
            }
        );
    }
    Ok(if same == Some(false) { ExitCode::FAILURE } else { ExitCode::SUCCESS })
}

async fn play(
    recorded: Recorded,
    handle: &Handle,
    watch: &FrameCounter<'_>,
) -> anyhow::Result<ReplayOutcome> {
    watch.look(None).await;
    let start = Instant::now();
    let (mut messages, mut dropped, mut first_ns, mut last_seq) = (0, 0, None, 0);
    let mut recorded_pixels_sha256 = None;
    for entry in recorded {
        match entry? {
            JournalEntry::Still(hash) => recorded_pixels_sha256 = Some(hash),
            JournalEntry::Other => {}
            JournalEntry::Sent(t_ns, message) => {
                let since = t_ns.saturating_sub(*first_ns.get_or_insert(t_ns));
                tokio::time::sleep_until((start + Duration::from_nanos(since)).into()).await;
                messages += 1;
                match send(handle, message) {
                    Some(seq) => last_seq = last_seq.max(seq),
                    None => dropped += 1,
                }
            }
        }
    }
    let still = tokio::time::timeout(STILL, watch.still_after(last_seq)).await.ok();
    let pixels_sha256 = still.as_ref().and_then(relief_client::pixels_sha256);
    let same = recorded_pixels_sha256.as_ref().zip(pixels_sha256.as_ref()).map(|(a, b)| a == b);
    let seconds = start.elapsed().as_secs_f64();
    Ok(ReplayOutcome { messages, dropped, seconds, recorded_pixels_sha256, pixels_sha256, same })
}

/// Says it again, now; gives its number, 0 for messages without one, `None` where it was dropped.
fn send(handle: &Handle, message: ClientMessage) -> Option<u64> {
    let now = handle.now_ns();
    match message {
        ClientMessage::Pose(pose) => handle.pose(now, pose.what),
        ClientMessage::Intent(intent) => handle.intent(now, intent.intent),
        ClientMessage::Settings(settings) => handle.settings(*settings).then_some(0),
        ClientMessage::Report(report) => {
            let report = relief_tracking::InputReport::decode(&report.bytes().ok()?).ok()?;
            handle.report(now, &report)
        }
        ClientMessage::Eyes(eyes) => handle.eyes(eyes).then_some(0),
        ClientMessage::Hello(_) | ClientMessage::Ack(_) => Some(0),
    }
}
