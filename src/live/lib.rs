//! Live sessions as bytes: the protocol `relief.v1` that server and clients speak over a WebSocket.
//!
//! It defines the header of binary frames, the codecs of colour and depth, the messages, and how a
//! client composes the frame of its display. Sockets, pacing and sessions are in `server` and
//! `client`. `docs/LIVE.md` describes the protocol byte by byte, [`protocol`] describes it for
//! programs.
//!
//! Depth is D (8 bits, 255 nearest) or Z (16 bits, 65535 nearest) of the display's settings;
//! lengths in mm, patient space.

mod codec;
mod describe;
mod eye_views;
mod format;
mod frame;
mod header;
mod interaction;
mod messages;
mod pings;

pub use codec::{CodecError, decode_color, decode_d8, decode_z16, encode_color, encode_d8, encode_z16};
pub use describe::{layouts_script, protocol};
pub use eye_views::{EyeViewLimits, EyeViewQuality};
pub use format::{ColorFormat, DepthFormat, LiveLayout};
pub use frame::{
    ComposeError, EncodedColor, EncodedDepth, MAX_PIXELS, Parts, ReceiveError, ReceivedDepth, ReceivedFrame,
    ReceivedLayers, ViewsOutput, assemble,
};
pub use header::{FIELDS, FLAGS, Field, FrameError, FrameHeader, HEADER_BYTES, MAGIC, VERSION};
pub use messages::{
    Accept, Ack, AnnotationsMessage, ClientMessage, ColorFormats, ErrorMessage, Eyes, Formats, Hello,
    IntentMessage, MAX_TEXT_BYTES, MessageError, MessageFault, NextLabel, NoFormat, OrbitPose, OutsideDepth,
    Peers, Play, Pose, PoseKind, Quality, RawReport, RemotePose, Role, ServerMessage, Settings, SnapTarget,
    SnapTo, SnappedPlace, StateMessage, TrackingMessage, Welcome, check_view_name,
};

pub use pings::PingLimit;

pub use interaction::{
    AppliedIntent, CursorMark, CutPlane, DisplayedPicture, Gestures, GrabMode, HandOptions, HandPose,
    HandSample, Home, Intent, IntentEffect, IntentError, Pivot, PlacePhase, SPACENAV_EVENT_BYTES,
    SpaceMouseEvent, Stage, ViewRecord, ViewState,
};

/// The WebSocket subprotocol.
pub const SUBPROTOCOL: &str = "relief.v1";

/// Frames that a client may have unacknowledged.
pub const MAX_IN_FLIGHT: usize = 2;
