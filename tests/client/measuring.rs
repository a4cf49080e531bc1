//! Measuring, against a server whose times and frames are known.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use futures_util::SinkExt;
use relief_client::{Composer, MeasurePlan, MeasureReport, measure};
use relief_display::{DisplayProfile, DisplaySettings, ProfileName};
use relief_live::{ClientMessage, FrameHeader};
use tokio_tungstenite::tungstenite::Message;

use crate::client::stand_in::{Socket, accept, frame, header, listen, next, options, welcome};

/// Changes each frame before the server sends it.
type Alter = fn(&mut FrameHeader, &mut Vec<u8>);

/// Sends a frame for each pose after 20 ms, at most two unacknowledged, and a still one when no
/// pose comes any more.
async fn serve(mut socket: Socket, alter: Alter, still_after: Duration) {
    socket.send(welcome("t", false)).await.unwrap();
    socket.send(Message::binary(frame(&header(1)))).await.unwrap();
    let (mut sequence, mut acked, mut newest, mut shown) = (1, 0, None, 0);
    loop {
        match tokio::time::timeout(still_after, next(&mut socket)).await {
            Ok(Some(ClientMessage::Pose(pose))) => newest = Some((pose.seq, pose.t_ns, false)),
            Ok(Some(ClientMessage::Ack(ack))) => acked = ack.frame,
            Ok(Some(_)) => {}
            Ok(None) => return,
            Err(_) => newest = newest.map(|(seq, t_ns, _)| (seq, t_ns, true)),
        }
        let Some((seq, t_ns, still)) = newest.filter(|(seq, _, still)| *seq > shown || *still) else {
            continue;
        };
        if sequence - acked >= 2 {
            continue;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
        (sequence, shown) = (sequence + 1, seq);
        if still {
            newest = None;
        }
        let mut header = FrameHeader { still, shows_seq: seq, shows_t_ns: t_ns, ..header(sequence) };
        let mut bytes = Vec::new();
        alter(&mut header, &mut bytes);
        let mut whole = frame(&header);
        if !bytes.is_empty() {
            let from = whole.len() - bytes.len();
            whole[from..].copy_from_slice(&bytes);
        }
        if socket.send(Message::binary(whole)).await.is_err() {
            return;
        }
    }
}

async fn measured(
    alter: Alter,
    clients: usize,
    stalled: usize,
    view: Option<&str>,
) -> (MeasureReport, usize) {
    let (listener, address) = listen(None).await;
    let watchers = Arc::new(AtomicUsize::new(0));
    let counted = Arc::clone(&watchers);
    tokio::spawn(async move {
        loop {
            let (socket, hello) = accept(&listener).await;
            counted.fetch_add(usize::from(hello.role == relief_live::Role::Watcher), Ordering::SeqCst);
            tokio::spawn(serve(socket, alter, Duration::from_millis(120)));
        }
    });
    let mut options = options(address);
    options.hello.view = view.map(str::to_owned);
    let asked = DisplaySettings::default().header();
    let composer = Composer::new(DisplayProfile::named(ProfileName::Philips42), Some(asked));
    let plan =
        MeasurePlan { options, seconds: 1.5, pose_hz: 60.0, clients, stalled, check_every: 1, composer };
    let (report, last) = measure(&plan).await.unwrap();
    assert!(last.is_some());
    (report, watchers.load(Ordering::SeqCst))
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn times_and_rates_are_those_of_the_server() {
    let (report, _) = measured(|_, _| (), 1, 0, None).await;
    assert!(report.frames_per_s > 8.0 && report.frames_per_s <= 50.0, "{report:?}");
    assert!(report.frames as f64 / report.seconds - report.frames_per_s < 1e-6);
    // 9 ms in all, of which 5 ms rendering and 1 ms waiting.
    assert_eq!((report.overhead_ms_p50, report.overhead_ms_p99), (Some(3.0), Some(3.0)));
    assert_eq!((report.render_ms_p50, report.wait_ms_p50), (Some(5.0), Some(1.0)));
    assert!(report.pose_to_frame_ms_p50.unwrap() >= 20.0, "{report:?}");
    // On a loaded machine a pause between two poses brings the still frame before the poses end.
    assert!(report.still_ms.is_some() && report.still_missing == 0, "{report:?}");
    assert_eq!((report.bad_headers, report.malformed, report.unreadable, report.reconnects), (0, 0, 0, 0));
    assert!(report.checked > 10 && report.lossless_share == Some(1.0));
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn wrong_header_rows_and_damaged_pictures_are_counted() {
    let (report, _) = measured(|header, _| header.display[1] = 65, 1, 0, None).await;
    assert!(report.bad_headers > 5, "{report:?}");
    let (report, _) = measured(
        |header, bytes| {
            if !header.still {
                bytes.extend([0xff; 40]);
            }
        },
        1,
        0,
        None,
    )
    .await;
    assert!(report.malformed > 5 && report.bad_headers == 0, "{report:?}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn clients_of_one_view_watch_and_stalled_ones_hold_two_frames() {
    let (report, watchers) = measured(|_, _| (), 3, 4, Some("soak")).await;
    assert_eq!((report.clients, report.stalled, watchers), (3, 4, 6), "all but the first look");
    assert!(report.frames_per_s_max > 8.0, "{report:?}");
    assert_eq!((report.stalled_failed, report.still_missing), (0, 0));
    let (report, _) = measured(|_, _| (), 1, 4, None).await;
    assert_eq!(report.stalled_frames_max, 2, "those that acknowledge nothing get two frames, and no more");
}
