//! VRPN, version 7: poses and buttons as the messages of trackers in virtual reality.
//!
//! Each side sends a cookie of 24 bytes, then messages: a header of 24 bytes (big-endian: bytes of
//! header and body, seconds and microseconds since 1970, sender, type, sequence number) and a body
//! that is padded to a multiple of eight bytes. Senders and types are numbers; descriptions, which
//! are messages too, give each number its name. Positions are in metres. Sockets are not here.

use std::collections::HashMap;

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use crate::pose::SensorPose;
use crate::report::Buttons;
use crate::tool::FARTHEST_MM;

/// The port of servers, for TCP and UDP.
pub const VRPN_PORT: u16 = 3883;
/// Buttons by their number in VRPN. The first button of another device has the effect of A.
pub const VRPN_BUTTONS: [Buttons; 11] = [
    Buttons::A,
    Buttons::B,
    Buttons::ONE,
    Buttons::TWO,
    Buttons::MINUS,
    Buttons::PLUS,
    Buttons::HOME,
    Buttons::LEFT,
    Buttons::RIGHT,
    Buttons::UP,
    Buttons::DOWN,
];

/// Version and log mode, which is off.
const COOKIE: [u8; 24] = *b"vrpn: ver. 07.38  0\0\0\0\0\0";
/// The part of the cookie in which versions agree that understand each other.
const MAJOR: &[u8] = b"vrpn: ver. 07.";
const HEADER_BYTES: usize = 24;
/// The longest message: VRPN's own buffers have this size.
const MAX_MESSAGE_BYTES: usize = 64_000;
/// Most senders, and most types, of a connection: as in VRPN's own library.
const MAX_NAMES: usize = 2000;
const MAX_NAME_BYTES: usize = 100;

const SENDER_DESCRIPTION: i32 = -1;
const TYPE_DESCRIPTION: i32 = -2;
const DISCONNECT: i32 = -5;

/// Types that [`VrpnWriter`] describes; a type's number is its place.
const TYPES: [&str; 4] =
    ["vrpn_Tracker Pos_Quat", "vrpn_Button Change", "vrpn_Base ping_message", "vrpn_Base pong_message"];
const POSE: usize = 0;
const BUTTON: usize = 1;
const PING: usize = 2;
const PONG: usize = 3;

/// Bytes that are not VRPN 7.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum VrpnError {
    /// Another protocol, or another major version.
    #[error("it does not speak VRPN 7")]
    Cookie,
    /// A message whose length is impossible.
    #[error("a VRPN message of {0} bytes, allowed: {HEADER_BYTES} to {MAX_MESSAGE_BYTES}")]
    Length(u32),
    /// More names than a connection may have, or a longer one.
    #[error("a VRPN connection with more than {MAX_NAMES} names, or one of more than {MAX_NAME_BYTES} bytes")]
    Names,
    /// A pose or a button with missing or impossible numbers.
    #[error("a VRPN message of type {0:?} with missing or impossible numbers")]
    Content(&'static str),
    /// The other side ends the connection.
    #[error("it closed the connection")]
    Closed,
}

/// The content of a message.
#[derive(Clone, Debug, PartialEq)]
pub enum VrpnEvent {
    /// The pose of one of a tracker's sensors: `tracker_from_sensor`.
    Pose {
        /// Name of the tracker.
        device: String,
        /// Number of the sensor.
        sensor: i32,
        /// Its pose, in mm.
        pose: SensorPose,
    },
    /// A button was pressed or released.
    Button {
        /// Name of the device.
        device: String,
        /// Number of the button.
        button: i32,
        /// Whether it is held now.
        is_held: bool,
    },
    /// A client asks whether this device is there.
    Ping {
        /// Name of the device.
        device: String,
    },
}

/// Decodes what one side of a connection sends.
#[derive(Clone, Debug, Default)]
pub struct VrpnReader {
    incoming: Vec<u8>,
    has_cookie: bool,
    senders: HashMap<i32, String>,
    types: HashMap<i32, String>,
}

impl VrpnReader {
    /// Adds received bytes. Call [`Self::next_event`] until it returns `None` before adding more.
    pub fn push(&mut self, bytes: &[u8]) {
        self.incoming.extend_from_slice(bytes);
    }

    /// The next event; `None` when more bytes are needed. Messages of other types are skipped.
    ///
    /// # Errors
    /// When the bytes are not VRPN, or the other side ends the connection.
    /// After [`VrpnError::Content`] the next message can be read.
    pub fn next_event(&mut self) -> Result<Option<VrpnEvent>, VrpnError> {
        if !self.has_cookie {
            let Some(cookie) = self.incoming.first_chunk::<{ COOKIE.len() }>() else { return Ok(None) };
            if !cookie.starts_with(MAJOR) {
                return Err(VrpnError::Cookie);
            }
            self.incoming.drain(..COOKIE.len());
            self.has_cookie = true;
        }
        while let Some(message) = self.next_message()? {
            if let Some(event) = self.event(&message)? {
                return Ok(Some(event));
            }
        }
        Ok(None)
    }

    fn next_message(&mut self) -> Result<Option<Message>, VrpnError> {
        let Some(head) = self.incoming.first_chunk::<HEADER_BYTES>() else { return Ok(None) };
        let length = u32::from_be_bytes([head[0], head[1], head[2], head[3]]);
        let bytes = length as usize;
        if !(HEADER_BYTES..=MAX_MESSAGE_BYTES).contains(&bytes) {
            return Err(VrpnError::Length(length));
        }
        let sender = i32::from_be_bytes([head[12], head[13], head[14], head[15]]);
        let kind = i32::from_be_bytes([head[16], head[17], head[18], head[19]]);
        let padded = bytes.next_multiple_of(8);
        if self.incoming.len() < padded {
            return Ok(None);
        }
        let body = self.incoming[HEADER_BYTES..bytes].to_vec();
        self.incoming.drain(..padded);
        Ok(Some(Message { sender, kind, body }))
    }

    fn event(&mut self, message: &Message) -> Result<Option<VrpnEvent>, VrpnError> {
        match message.kind {
            SENDER_DESCRIPTION => return describe(&mut self.senders, message).map(|()| None),
            TYPE_DESCRIPTION => return describe(&mut self.types, message).map(|()| None),
            DISCONNECT => return Err(VrpnError::Closed),
            _ => {}
        }
        let (Some(device), Some(kind)) = (self.senders.get(&message.sender), self.types.get(&message.kind))
        else {
            return Ok(None);
        };
        let Some(kind) = TYPES.iter().position(|name| name == kind) else { return Ok(None) };
        let device = device.clone();
        let incomplete = VrpnError::Content(TYPES[kind]);
        match kind {
            POSE => {
                let (sensor, pose) = read_pose(&message.body).ok_or(incomplete)?;
                Ok(Some(VrpnEvent::Pose { device, sensor, pose }))
            }
            BUTTON => {
                let [button, state] = integers(&message.body).ok_or(incomplete)?;
                Ok(Some(VrpnEvent::Button { device, button, is_held: state != 0 }))
            }
            PING => Ok(Some(VrpnEvent::Ping { device })),
            _ => Ok(None),
        }
    }
}

struct Message {
    sender: i32,
    kind: i32,
    body: Vec<u8>,
}

/// Reads a description: the length of a name with its final zero, and the name.
fn describe(names: &mut HashMap<i32, String>, message: &Message) -> Result<(), VrpnError> {
    let name = message.body.get(4..).unwrap_or_default();
    let name = name.split(|byte| *byte == 0).next().unwrap_or_default();
    let is_new = !names.contains_key(&message.sender);
    if name.len() > MAX_NAME_BYTES || (is_new && names.len() >= MAX_NAMES) {
        return Err(VrpnError::Names);
    }
    names.insert(message.sender, String::from_utf8_lossy(name).into_owned());
    Ok(())
}

fn integers(body: &[u8]) -> Option<[i32; 2]> {
    let (numbers, _) = body.as_chunks::<4>();
    numbers.first_chunk::<2>().map(|numbers| numbers.map(i32::from_be_bytes))
}

/// A sensor's number, padding, position in metres, and quaternion x, y, z, w.
fn read_pose(body: &[u8]) -> Option<(i32, SensorPose)> {
    let [sensor, _] = integers(body)?;
    let (numbers, _) = body.get(8..)?.as_chunks::<8>();
    let [px, py, pz, x, y, z, w] = numbers.first_chunk::<7>()?.map(f64::from_be_bytes);
    let position = Vector3::new(px, py, pz) * 1000.0;
    let quaternion = Quaternion::new(w, x, y, z);
    let is_rotation = (quaternion.norm() - 1.0).abs() < 1e-3;
    if !is_rotation || position.iter().any(|mm| mm.is_nan() || mm.abs() > FARTHEST_MM) {
        return None;
    }
    Some((sensor, SensorPose { position, orientation: UnitQuaternion::from_quaternion(quaternion) }))
}

/// Encodes the messages of one device.
#[derive(Clone, Debug, Default)]
pub struct VrpnWriter {
    sequence: u32,
}

impl VrpnWriter {
    /// The first bytes of a connection: the cookie, the name of the device, and the types of messages.
    #[must_use]
    pub fn greeting(&mut self, device: &str) -> Vec<u8> {
        let mut bytes = COOKIE.to_vec();
        bytes.extend(self.description(SENDER_DESCRIPTION, 0, device));
        for (number, name) in (0..).zip(TYPES) {
            bytes.extend(self.description(TYPE_DESCRIPTION, number, name));
        }
        bytes
    }

    /// The pose of the device's sensor 0, in mm, at this time (ns since 1970).
    #[must_use]
    pub fn pose(&mut self, unix_ns: u64, pose: &SensorPose) -> Vec<u8> {
        let numbers =
            (pose.position / 1000.0).iter().copied().chain(pose.orientation_xyzw()).collect::<Vec<_>>();
        let body: Vec<u8> =
            [0; 8].into_iter().chain(numbers.into_iter().flat_map(f64::to_be_bytes)).collect();
        self.message(unix_ns, 0, POSE as i32, &body)
    }

    /// The buttons that changed between two sets.
    #[must_use]
    pub fn buttons(&mut self, unix_ns: u64, before: Buttons, now: Buttons) -> Vec<u8> {
        let mut bytes = Vec::new();
        for (number, button) in (0_i32..).zip(VRPN_BUTTONS) {
            if before.contains(button) != now.contains(button) {
                let body = [number.to_be_bytes(), i32::from(now.contains(button)).to_be_bytes()].concat();
                bytes.extend(self.message(unix_ns, 0, BUTTON as i32, &body));
            }
        }
        bytes
    }

    /// The answer to [`VrpnEvent::Ping`].
    #[must_use]
    pub fn pong(&mut self, unix_ns: u64) -> Vec<u8> {
        self.message(unix_ns, 0, PONG as i32, &[])
    }

    fn description(&mut self, kind: i32, number: i32, name: &str) -> Vec<u8> {
        let mut body = (name.len() as u32 + 1).to_be_bytes().to_vec();
        body.extend_from_slice(name.as_bytes());
        body.push(0);
        self.message(0, number, kind, &body)
    }

    fn message(&mut self, unix_ns: u64, sender: i32, kind: i32, body: &[u8]) -> Vec<u8> {
        let length = HEADER_BYTES + body.len();
        let mut bytes = Vec::with_capacity(length.next_multiple_of(8));
        bytes.extend((length as u32).to_be_bytes());
        // Times of VRPN are 32-bit numbers.
        bytes.extend(((unix_ns / 1_000_000_000) as u32).to_be_bytes());
        bytes.extend(((unix_ns % 1_000_000_000 / 1000) as u32).to_be_bytes());
        bytes.extend(sender.to_be_bytes());
        bytes.extend(kind.to_be_bytes());
        bytes.extend(self.sequence.to_be_bytes());
        bytes.extend(body);
        bytes.resize(length.next_multiple_of(8), 0);
        self.sequence = self.sequence.wrapping_add(1);
        bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose() -> SensorPose {
        SensorPose {
            position: Vector3::new(-120.5, 30.25, 800.0),
            orientation: UnitQuaternion::from_euler_angles(0.3, -0.9, 2.0),
        }
    }

    fn events(bytes: &[u8], part: usize) -> Result<Vec<VrpnEvent>, VrpnError> {
        let (mut reader, mut events) = (VrpnReader::default(), Vec::new());
        for part in bytes.chunks(part) {
            reader.push(part);
            while let Some(event) = reader.next_event()? {
                events.push(event);
            }
        }
        Ok(events)
    }

    #[test]
    fn what_is_written_is_read_in_parts_of_any_size() {
        let mut writer = VrpnWriter::default();
        let mut bytes = writer.greeting("Wiimote");
        bytes.extend(writer.pose(1_500_000_000, &pose()));
        let held = Buttons::A.with(Buttons::DOWN);
        bytes.extend(writer.buttons(0, Buttons::A, Buttons::A));
        bytes.extend(writer.buttons(0, Buttons::default(), held));
        bytes.extend(writer.buttons(0, held, Buttons::DOWN));
        bytes.extend(writer.pong(0));
        for part in [1, 7, 24, bytes.len()] {
            let read = events(&bytes, part).unwrap();
            let [VrpnEvent::Pose { device, sensor: 0, pose: found }, rest @ ..] = &read[..] else {
                panic!("{read:?}")
            };
            assert_eq!(device, "Wiimote");
            assert!((found.position - pose().position).norm() < 1e-9, "{found:?}");
            assert!(found.orientation.angle_to(&pose().orientation) < 1e-7, "{found:?}");
            let button = |button, is_held| VrpnEvent::Button { device: device.clone(), button, is_held };
            assert_eq!(rest, [button(0, true), button(10, true), button(0, false)]);
        }
    }

    /// Bytes of the C++ library of VRPN 7.38, read from a socket.
    #[test]
    fn messages_have_the_bytes_of_the_original() {
        let mut writer = VrpnWriter::default();
        let greeting = writer.greeting("Stylus");
        assert_eq!(greeting[..24], *b"vrpn: ver. 07.38  0\0\0\0\0\0");
        let description = [
            &[0, 0, 0, 35, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 255, 255, 255, 255, 0, 0, 0, 0][..],
            &[0, 0, 0, 7],
            b"Stylus\0",
            &[0; 5],
        ]
        .concat();
        assert_eq!(greeting[24..64], description);
        let pose = SensorPose {
            position: Vector3::new(10.0, -20.0, 900.0),
            orientation: UnitQuaternion::from_scaled_axis(Vector3::z() * std::f64::consts::FRAC_PI_2),
        };
        let sent = writer.pose(2_000_003_000, &pose);
        assert_eq!(sent[..12], [0, 0, 0, 88, 0, 0, 0, 2, 0, 0, 0, 3]);
        assert_eq!(sent[32..48], *b"?\x84z\xe1G\xae\x14{\xbf\x94z\xe1G\xae\x14{");
    }

    #[test]
    fn other_protocols_and_impossible_messages_are_refused() {
        assert_eq!(events(&[b'x'; 24], 24), Err(VrpnError::Cookie));
        assert_eq!(events(b"vrpn: ver. 06.00  0\0\0\0\0\0", 24), Err(VrpnError::Cookie));
        let with = |message: &[u8]| events(&[&COOKIE, message].concat(), 100);
        assert_eq!(with(&[0; 24]), Err(VrpnError::Length(0)));
        assert_eq!(with(&[255; 24]), Err(VrpnError::Length(u32::MAX)));
        let mut writer = VrpnWriter::default();
        let mut bytes = writer.greeting("a");
        bytes.extend(writer.message(0, 0, POSE as i32, &[0; 64]));
        assert_eq!(events(&bytes, 100), Err(VrpnError::Content("vrpn_Tracker Pos_Quat")));
        let long = writer.description(SENDER_DESCRIPTION, 5, &"n".repeat(101));
        assert_eq!(with(&long), Err(VrpnError::Names));
        let many: Vec<u8> =
            (0..2001).flat_map(|number| writer.description(TYPE_DESCRIPTION, number, "t")).collect();
        assert_eq!(with(&many), Err(VrpnError::Names));
        assert_eq!(with(&writer.message(0, 0, DISCONNECT, &[])), Err(VrpnError::Closed));
    }
}
