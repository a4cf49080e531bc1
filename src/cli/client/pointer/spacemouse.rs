//! A SpaceMouse behind spacenavd's socket; [`SpaceMouseEvent`] says what its movements do.

use std::io::Read;
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

use anyhow::Context;
use relief_client::Handle;
use relief_live::{SPACENAV_EVENT_BYTES, SpaceMouseEvent};

/// The time between two checks of the thread for the end of the session.
const LOOK: Duration = Duration::from_millis(200);

pub(super) fn start(socket: &Path, handle: &Handle) -> anyhow::Result<()> {
    let stream = UnixStream::connect(socket).with_context(|| {
        format!("cannot connect to spacenavd at {}; is it installed and running?", socket.display())
    })?;
    stream.set_read_timeout(Some(LOOK))?;
    let handle = handle.clone();
    let read = move || {
        if let Err(error) = relay(stream, &handle) {
            eprintln!("the SpaceMouse cannot be read: {error}");
        }
    };
    std::thread::Builder::new().name("spacemouse".to_owned()).spawn(read)?;
    Ok(())
}

fn relay(mut stream: UnixStream, handle: &Handle) -> std::io::Result<()> {
    let (mut event, mut filled, mut moves_cursor) = ([0; SPACENAV_EVENT_BYTES], 0, false);
    while !handle.is_stopped() {
        match stream.read(&mut event[filled..]) {
            Ok(0) => return Err(std::io::Error::other("spacenavd ended")),
            Ok(bytes) => filled += bytes,
            Err(error)
                if matches!(error.kind(), std::io::ErrorKind::WouldBlock | std::io::ErrorKind::TimedOut) =>
            {
                continue;
            }
            Err(error) => return Err(error),
        }
        if filled < SPACENAV_EVENT_BYTES {
            continue;
        }
        filled = 0;
        let event = SpaceMouseEvent::read(&event);
        if let SpaceMouseEvent::Button { number: 0, is_pressed } = event {
            moves_cursor = is_pressed;
        }
        for intent in event.intents(moves_cursor) {
            handle.intent(handle.now_ns(), intent);
        }
    }
    Ok(())
}
