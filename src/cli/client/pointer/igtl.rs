//! A tracker that sends OpenIGTLink: each transform of the device is a pose of the tool.

use relief_tracking::{IGTL_HEADER_BYTES, IgtlError, IgtlHeader, igtl_pose};

use super::connection::Connection;
use super::network::Network;

/// Largest message of another type that is skipped, bytes: some trackers send pictures, too.
const MOST_SKIPPED: u64 = 256 << 20;

/// Reads messages until the connection or the session ends.
pub(super) fn relay(connection: &mut Connection, source: &Network) -> std::io::Result<()> {
    let mut head = [0; IGTL_HEADER_BYTES];
    while connection.fill(&mut head)? {
        connection.tool.check_silence();
        let header = match IgtlHeader::decode(&head) {
            Ok(header) => header,
            Err(IgtlError::Body(bytes)) if bytes <= MOST_SKIPPED => {
                skip(connection, bytes)?;
                continue;
            }
            Err(error) => return Err(std::io::Error::other(error)),
        };
        let mut body = vec![0; header.body_bytes];
        if !connection.fill(&mut body)? {
            return Ok(());
        }
        if source.device.as_ref().is_some_and(|device| *device != header.device) {
            continue;
        }
        match igtl_pose(&header, &body) {
            Ok(Some(pose)) => connection.tool.moved(&pose),
            Ok(None) => {}
            Err(error) => connection.tool.report(&error),
        }
    }
    Ok(())
}

fn skip(connection: &mut Connection, bytes: u64) -> std::io::Result<()> {
    let (mut left, mut dropped) = (bytes, [0; 16 << 10]);
    while left > 0 {
        let part = dropped.len().min(usize::try_from(left).unwrap_or(usize::MAX));
        if !connection.fill(&mut dropped[..part])? {
            return Ok(());
        }
        left -= part as u64;
    }
    Ok(())
}
