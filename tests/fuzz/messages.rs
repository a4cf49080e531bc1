//! Whatever bytes come over a live session, as frames, colour, depth, messages and intents.

use relief_display::{DisplayProfile, ProfileName};
use relief_live::{
    ClientMessage, ColorFormat, DepthFormat, FrameHeader, HEADER_BYTES, Intent, Parts, ReceivedFrame,
    ServerMessage, decode_color, decode_d8, decode_z16,
};

/// A header that is read is written the same; a frame that is read composes or says why not.
pub fn frame(bytes: &[u8]) {
    if let Ok(header) = FrameHeader::decode(bytes) {
        assert_eq!(header.encode()[..], bytes[..HEADER_BYTES]);
    }
    let _ = Parts::of(bytes);
    if let Ok(frame) = ReceivedFrame::decode(bytes) {
        let _ = frame.compose(&DisplayProfile::named(ProfileName::Philips42));
    }
    let size = [16, 8];
    for format in ColorFormat::ALL {
        let _ = decode_color(size, bytes, format);
    }
    for format in DepthFormat::ALL {
        let _ = decode_d8(size, bytes, format);
        let _ = decode_z16(size, bytes, format);
    }
}

/// A message that is read is written as one that can be read.
pub fn message(bytes: &[u8]) {
    let Ok(text) = std::str::from_utf8(bytes) else { return };
    if let Ok(message) = ClientMessage::parse(text) {
        assert!(ClientMessage::parse(&message.to_text()).is_ok());
    }
    let _ = ServerMessage::parse(text);
}

pub fn intent(bytes: &[u8]) {
    let _ = Intent::from_json(bytes);
}
