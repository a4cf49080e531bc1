//! OpenIGTLink, version 1: poses as the messages that navigation software reads.
//!
//! A message is a header of 58 bytes (big-endian: version, type, device name, time, length and
//! CRC-64 of the body) and a body. TRANSFORM has twelve 32-bit floats, the columns of the rotation
//! and the translation in mm; POSITION the translation and a quaternion; TDATA a list of named
//! tools, of which those that are not seen are left out.

use nalgebra::{Matrix3, Vector3};

use crate::pose::SensorPose;
use crate::tool::{FARTHEST_MM, is_rotation, quaternion};

/// Bytes of a header.
pub const IGTL_HEADER_BYTES: usize = 58;
/// The longest body that is read; what clients send is far shorter.
pub(crate) const MAX_BODY_BYTES: u64 = 4096;

const VERSION: u16 = 1;
/// Bytes of a TRANSFORM's content.
const TRANSFORM_BYTES: usize = 48;
const CRC: crc::Crc<u64> = crc::Crc::<u64>::new(&crc::CRC_64_ECMA_182);
/// A tracked instrument of six degrees of freedom.
const TOOL_6D: u8 = 2;

/// An invalid header.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum IgtlError {
    /// Another protocol, or one that this is not.
    #[error("OpenIGTLink version {0}, expected 1 to 3")]
    Version(u16),
    /// A body that no client sends.
    #[error("an OpenIGTLink body of {0} bytes, allowed: up to {MAX_BODY_BYTES}")]
    Body(u64),
    /// Not the body that the header is of.
    #[error("the body of an OpenIGTLink message does not have its checksum")]
    Checksum,
    /// A body that is too short for its type.
    #[error("an OpenIGTLink {kind} has {found} bytes, expected {expected}")]
    Length {
        /// The type.
        kind: &'static str,
        /// Bytes that it has.
        found: usize,
        /// Bytes that it must have.
        expected: usize,
    },
    /// A matrix that scales, mirrors or shears, or a place that no tool reaches.
    #[error("an OpenIGTLink transform is not a rotation and a translation in mm")]
    NotRigid,
}

/// The content of a header.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct IgtlHeader {
    /// Version of the protocol, 1 to 3.
    pub version: u16,
    /// Message type, such as `STT_TDATA`.
    pub kind: String,
    /// Name of the device, such as `StylusToReference`.
    pub device: String,
    /// Checksum of the body.
    pub crc: u64,
    /// Bytes of the body.
    pub body_bytes: usize,
}

impl IgtlHeader {
    /// Reads a header.
    ///
    /// # Errors
    /// When the version is unknown or the body too long.
    pub fn decode(bytes: &[u8; IGTL_HEADER_BYTES]) -> Result<Self, IgtlError> {
        let version = u16::from_be_bytes([bytes[0], bytes[1]]);
        if !(1..=3).contains(&version) {
            return Err(IgtlError::Version(version));
        }
        let mut length = [0; 8];
        length.copy_from_slice(&bytes[42..50]);
        let length = u64::from_be_bytes(length);
        if length > MAX_BODY_BYTES {
            return Err(IgtlError::Body(length));
        }
        let name = |bytes: &[u8]| {
            let name = bytes.split(|byte| *byte == 0).next().unwrap_or_default();
            String::from_utf8_lossy(name).into_owned()
        };
        let mut crc = [0; 8];
        crc.copy_from_slice(&bytes[50..58]);
        Ok(Self {
            version,
            kind: name(&bytes[2..14]),
            device: name(&bytes[14..34]),
            crc: u64::from_be_bytes(crc),
            body_bytes: length as usize,
        })
    }
}

/// The pose of a TRANSFORM; `None` for a message of another type.
///
/// # Errors
/// When the body is damaged or too short, or the transform is not rigid.
pub fn igtl_pose(header: &IgtlHeader, body: &[u8]) -> Result<Option<SensorPose>, IgtlError> {
    if header.kind != "TRANSFORM" {
        return Ok(None);
    }
    if CRC.checksum(body) != header.crc {
        return Err(IgtlError::Checksum);
    }
    let content = if header.version == 3 { content_of(body) } else { Some(body) };
    let (numbers, _) = content.unwrap_or_default().as_chunks::<4>();
    let length = || IgtlError::Length { kind: "TRANSFORM", found: body.len(), expected: TRANSFORM_BYTES };
    let numbers = numbers.first_chunk::<12>().ok_or_else(length)?;
    let numbers = numbers.map(|number| f64::from(f32::from_be_bytes(number)));
    let turn = Matrix3::from_column_slice(&numbers[..9]);
    let position = Vector3::from_column_slice(&numbers[9..]);
    if !is_rotation(&turn) || position.iter().any(|mm| mm.is_nan() || mm.abs() > FARTHEST_MM) {
        return Err(IgtlError::NotRigid);
    }
    Ok(Some(SensorPose { position, orientation: quaternion(&turn) }))
}

/// The content behind the extended header of version 3, whose first number is its size.
fn content_of(body: &[u8]) -> Option<&[u8]> {
    let size = body.first_chunk::<2>().map(|size| u16::from_be_bytes(*size))?;
    body.get(usize::from(size)..)
}

/// A message of this type, from this device, at this time (ns since 1970).
#[must_use]
pub fn igtl_message(kind: &str, device: &str, unix_ns: u64, body: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(IGTL_HEADER_BYTES + body.len());
    bytes.extend(VERSION.to_be_bytes());
    bytes.extend(padded::<12>(kind));
    bytes.extend(padded::<20>(device));
    let (seconds, rest) = (unix_ns / 1_000_000_000, unix_ns % 1_000_000_000);
    let fraction = (rest << 32) / 1_000_000_000;
    bytes.extend((seconds << 32 | fraction).to_be_bytes());
    bytes.extend((body.len() as u64).to_be_bytes());
    bytes.extend(CRC.checksum(body).to_be_bytes());
    bytes.extend(body);
    bytes
}

/// A TRANSFORM: `beacon_from_sensor`.
#[must_use]
pub fn igtl_transform(device: &str, unix_ns: u64, pose: &SensorPose) -> Vec<u8> {
    igtl_message("TRANSFORM", device, unix_ns, &matrix(pose))
}

/// A POSITION with its quaternion.
#[must_use]
pub fn igtl_position(device: &str, unix_ns: u64, pose: &SensorPose) -> Vec<u8> {
    let numbers = pose.position.iter().copied().chain(pose.orientation_xyzw());
    let body: Vec<u8> = numbers.flat_map(|number| (number as f32).to_be_bytes()).collect();
    igtl_message("POSITION", device, unix_ns, &body)
}

/// A TDATA with one tool, or with none when it is not seen.
#[must_use]
pub fn igtl_tracking_data(device: &str, unix_ns: u64, tool: &str, pose: Option<&SensorPose>) -> Vec<u8> {
    let mut body = Vec::new();
    if let Some(pose) = pose {
        body.extend(padded::<20>(tool));
        body.extend([TOOL_6D, 0]);
        body.extend(matrix(pose));
    }
    igtl_message("TDATA", device, unix_ns, &body)
}

/// The answer to STT_TDATA and STP_TDATA.
#[must_use]
pub fn igtl_acknowledgement(device: &str, unix_ns: u64) -> Vec<u8> {
    igtl_message("RTS_TDATA", device, unix_ns, &[0])
}

/// Columns of the rotation, then the translation, as big-endian 32-bit floats.
fn matrix(pose: &SensorPose) -> Vec<u8> {
    let rotation = pose.orientation.to_rotation_matrix().into_inner();
    let numbers = rotation.iter().chain(pose.position.iter()); // nalgebra goes by columns
    numbers.flat_map(|number| (*number as f32).to_be_bytes()).collect()
}

fn padded<const N: usize>(text: &str) -> [u8; N] {
    let mut bytes = [0; N];
    for (byte, source) in bytes.iter_mut().take(N - 1).zip(text.bytes()) {
        *byte = source;
    }
    bytes
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};

    use super::*;

    /// The numbers of the official test messages (transform, position, tracking data) and the
    /// checksums given there.
    #[test]
    fn messages_have_the_official_bytes() {
        let columns: [f32; 9] = [
            -0.954_892,
            0.196_632,
            -0.222_525,
            -0.196_632,
            0.142_857,
            0.970_014,
            0.222_525,
            0.970_014,
            -0.097_749_1,
        ];
        let body: Vec<u8> =
            columns.into_iter().chain([46.0531, 19.4709, 46.0531]).flat_map(f32::to_be_bytes).collect();
        let sent = igtl_message("TRANSFORM", "DeviceName", 0, &body);
        assert_eq!(sent[..2], [0, 1]);
        assert_eq!(sent[50..58], 0xf6dd_2b8e_b4df_6dd2_u64.to_be_bytes());
        assert_eq!(&sent[2..14], b"TRANSFORM\0\0\0");
        assert_eq!(&sent[14..34], b"DeviceName\0\0\0\0\0\0\0\0\0\0");
        assert_eq!(sent[42..50], 48_u64.to_be_bytes());

        let position: [f32; 7] = [46.0531, 19.4709, 46.0531, 0.0, 0.577_350_26, 0.577_350_26, 0.333_333_34];
        let body: Vec<u8> = position.into_iter().flat_map(f32::to_be_bytes).collect();
        assert_eq!(igtl_message("POSITION", "x", 0, &body)[50..58], 0x6bc8_d628_2b79_a3a1_u64.to_be_bytes());
        let header = IgtlHeader::decode(sent[..IGTL_HEADER_BYTES].as_array().unwrap()).unwrap();
        assert_eq!((&*header.kind, &*header.device, header.body_bytes), ("TRANSFORM", "DeviceName", 48));
    }

    #[test]
    fn transforms_are_read_back_and_damaged_ones_refused() {
        let pose = SensorPose {
            position: Vector3::new(-120.5, 30.25, 800.0),
            orientation: UnitQuaternion::from_euler_angles(0.3, -0.9, 2.0),
        };
        let sent = igtl_transform("Stylus", 0, &pose);
        let (head, body) = sent.split_first_chunk::<IGTL_HEADER_BYTES>().unwrap();
        let header = IgtlHeader::decode(head).unwrap();
        let found = igtl_pose(&header, body).unwrap().unwrap();
        assert!((found.position - pose.position).norm() < 1e-3, "{found:?}");
        assert!(found.orientation.angle_to(&pose.orientation) < 1e-6, "{found:?}");
        let mut damaged = body.to_vec();
        damaged[5] ^= 1;
        assert_eq!(igtl_pose(&header, &damaged), Err(IgtlError::Checksum));
        let of = |body: &[u8], version| {
            let header = IgtlHeader { version, crc: CRC.checksum(body), ..header.clone() };
            igtl_pose(&header, body)
        };
        assert!(matches!(of(&body[..40], 1), Err(IgtlError::Length { .. })));
        assert_eq!(of(&[0; 48], 1), Err(IgtlError::NotRigid));
        // Version 3 has 12 bytes before the content, which they count.
        let extended = [&[0, 12, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0], body].concat();
        assert_eq!(of(&extended, 3), Ok(Some(found)));
        assert!(of(&[255; 20], 3).is_err() && of(&[], 3).is_err());
        let status = IgtlHeader { kind: "STATUS".to_owned(), ..header };
        assert_eq!(igtl_pose(&status, &[]), Ok(None));
    }

    #[test]
    fn times_are_seconds_and_fractions_of_two() {
        let sent = igtl_message("STATUS", "d", 1_234_567_890_500_000_000, &[]);
        assert_eq!(sent[34..42], (1_234_567_890_u64 << 32 | 1 << 31).to_be_bytes());
    }

    #[test]
    fn poses_are_written_by_columns_in_mm() {
        let pose = SensorPose {
            position: Vector3::new(1.0, 2.0, 3.0),
            orientation: UnitQuaternion::from_scaled_axis(Vector3::z() * std::f64::consts::FRAC_PI_2),
        };
        let floats: Vec<f32> =
            matrix(&pose).as_chunks::<4>().0.iter().map(|b| f32::from_be_bytes(*b)).collect();
        let expected = [0.0, 1.0, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 2.0, 3.0];
        assert!(floats.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-6), "{floats:?}");
        assert_eq!(igtl_tracking_data("d", 0, "Wiimote", Some(&pose)).len(), IGTL_HEADER_BYTES + 70);
        assert_eq!(igtl_tracking_data("d", 0, "Wiimote", None).len(), IGTL_HEADER_BYTES);
        assert_eq!(igtl_position("d", 0, &pose).len(), IGTL_HEADER_BYTES + 28);
    }

    #[test]
    fn foreign_headers_are_refused() {
        let mut bytes = [0; IGTL_HEADER_BYTES];
        assert_eq!(IgtlHeader::decode(&bytes), Err(IgtlError::Version(0)));
        bytes[1] = 2;
        bytes[42] = 1;
        assert!(matches!(IgtlHeader::decode(&bytes), Err(IgtlError::Body(_))));
    }
}
