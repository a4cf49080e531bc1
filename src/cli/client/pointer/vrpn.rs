//! A tracker that speaks VRPN: each report of the device's sensor is a pose of the tool. Buttons of a
//! device of the same name are those of the tool.

use std::io::Write;

use relief_tracking::{VRPN_BUTTONS, VrpnError, VrpnEvent, VrpnReader, VrpnWriter};

use super::connection::Connection;
use super::network::Network;

/// Reads messages until the connection or the session ends.
pub(super) fn relay(connection: &mut Connection, source: &Network) -> std::io::Result<()> {
    // The greeting names this side's device, which sends nothing.
    connection.stream.write_all(&VrpnWriter::default().greeting("Relief"))?;
    let (mut reader, mut buffer) = (VrpnReader::default(), [0; 4096]);
    while let Some(bytes) = connection.read(&mut buffer)? {
        reader.push(&buffer[..bytes]);
        loop {
            match reader.next_event() {
                Ok(Some(event)) => apply(&event, connection, source),
                Ok(None) => break,
                Err(error @ VrpnError::Content(_)) => connection.tool.report(&error),
                Err(error) => return Err(std::io::Error::other(error)),
            }
        }
        connection.tool.check_silence();
    }
    Ok(())
}

fn apply(event: &VrpnEvent, connection: &mut Connection, source: &Network) {
    let is_meant = |device: &String| source.device.as_ref() == Some(device);
    match event {
        VrpnEvent::Pose { device, sensor, pose } if is_meant(device) && *sensor == source.sensor => {
            connection.tool.moved(pose);
        }
        VrpnEvent::Button { device, button, is_held } if is_meant(device) => {
            let button = usize::try_from(*button).ok().and_then(|button| VRPN_BUTTONS.get(button));
            if let Some(button) = button {
                connection.tool.pressed(*button, *is_held);
            }
        }
        _ => {}
    }
}
