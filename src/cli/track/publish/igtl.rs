//! OpenIGTLink: every client gets TRANSFORM and POSITION, and TDATA when it asks for it.

use std::io::ErrorKind;

use relief_tracking::{IGTL_HEADER_BYTES, IgtlHeader, SensorPose};

const DEVICE: &str = "WiimoteToBeacon";
const TOOL: &str = "Wiimote";

/// One client's side of the protocol.
#[derive(Default)]
pub(super) struct IgtlSession {
    incoming: Vec<u8>,
    wants_tracking_data: bool,
}

impl IgtlSession {
    /// Executes STT_TDATA and STP_TDATA.
    pub(super) fn answer(&mut self, received: &[u8], unix_ns: u64) -> std::io::Result<Vec<u8>> {
        self.incoming.extend_from_slice(received);
        let mut answer = Vec::new();
        while let Some(head) = self.incoming.first_chunk::<IGTL_HEADER_BYTES>() {
            let header = IgtlHeader::decode(head)
                .map_err(|error| std::io::Error::new(ErrorKind::InvalidData, error))?;
            let whole = IGTL_HEADER_BYTES + header.body_bytes;
            if self.incoming.len() < whole {
                break;
            }
            self.incoming.drain(..whole);
            if matches!(header.kind.as_str(), "STT_TDATA" | "STP_TDATA") {
                self.wants_tracking_data = header.kind == "STT_TDATA";
                answer.extend(relief_tracking::igtl_acknowledgement(DEVICE, unix_ns));
            }
        }
        Ok(answer)
    }

    /// The messages of a new state.
    pub(super) fn publish(&mut self, unix_ns: u64, pose: Option<&SensorPose>) -> Vec<u8> {
        let mut bytes = Vec::new();
        if let Some(pose) = pose {
            bytes.extend(relief_tracking::igtl_transform(DEVICE, unix_ns, pose));
            bytes.extend(relief_tracking::igtl_position(DEVICE, unix_ns, pose));
        }
        if self.wants_tracking_data {
            bytes.extend(relief_tracking::igtl_tracking_data(DEVICE, unix_ns, TOOL, pose));
        }
        bytes
    }
}
