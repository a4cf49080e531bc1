//! The arguments of `relief client`.

use std::net::IpAddr;
use std::path::PathBuf;

use crate::choices::layouts;
use crate::client::eyes::EyesArguments;
use crate::client::pointer::PointerArguments;
use crate::client::remote::RemoteArguments;
use crate::scene::parse_size;
use crate::slice::parse_triple;
use relief_annotation::ShownSets;
use relief_client::ServerAddress;
use relief_display::{Layout, ProfileName, ScreenPlane};
use relief_film::FilmCodec;
use relief_live::{LiveLayout, OrbitPose, check_view_name};

/// Show the frames of a live session on this machine's display, pixel for pixel, and send it the
/// Wiimote's poses.
#[derive(Debug, clap::Args)]
#[command(after_help = AFTER_HELP)]
pub(crate) struct ClientArguments {
    /// The server: http://HOST:PORT or https://HOST:PORT
    #[arg(long, value_name = "URL")]
    pub(crate) server: ServerAddress,
    /// Token for a server that asks who you are, made by `relief token add`; better as RELIEF_TOKEN,
    /// which the list of processes does not show
    #[arg(long, value_name = "TOKEN", env = "RELIEF_TOKEN", hide_env_values = true)]
    pub(crate) token: Option<String>,
    /// Trust servers with a certificate of these authorities, PEM, and no others
    #[arg(long, value_name = "FILE.pem")]
    pub(crate) ca: Option<PathBuf>,
    /// Name of a view that several clients share; one of its own when left out
    #[arg(long, value_name = "NAME", value_parser = view_name)]
    pub(crate) view: Option<String>,
    /// Volume, by its id; the server's first one when left out, also after the server was restarted
    /// with another
    #[arg(long, value_name = "ID")]
    pub(crate) volume: Option<String>,
    /// Whether this client may move the view, or looks
    #[arg(long, value_enum, default_value_t = Part::Presenter)]
    pub(crate) role: Part,
    /// Preset of colours and light
    #[arg(long, value_name = "NAME")]
    pub(crate) preset: Option<String>,
    /// Look from there: azimuth and elevation, degrees, and zoom if you like
    #[arg(long, value_name = "AZ,EL[,ZOOM]", value_parser = parse_look, allow_hyphen_values = true)]
    pub(crate) look: Option<OrbitPose>,
    /// The display: philips-20, philips-42 or dimenco-4k, for its frame size and depth curve; that
    /// of the layout when left out
    #[arg(long, value_name = "NAME", value_parser = profile_name)]
    pub(crate) profile: Option<ProfileName>,
    #[arg(long, value_name = "NAME", help = layouts("Layout of the frame; the client makes views itself", is_shown))]
    pub(crate) layout: Option<Layout>,
    #[command(flatten)]
    pub(crate) views: ViewsArguments,
    /// Depth effect that the display's header asks for; 64 is 100 %
    #[arg(long, value_name = "0..255")]
    pub(crate) factor: Option<u8>,
    /// Disparity on the screen plane that the display's header asks for
    #[arg(long, value_name = "0..255")]
    pub(crate) offset: Option<u8>,
    /// The point on the plane of the screen, where a display is sharpest: cursor, as it moves, or a
    /// point of the patient, LPS mm
    #[arg(long, value_name = "cursor|X,Y,Z", value_parser = parse_screen_plane, allow_hyphen_values = true)]
    pub(crate) screen_plane: Option<ScreenPlane>,
    /// Size of the picture (in 2D-plus-depth layouts, of each half)
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub(crate) size: Option<[u32; 2]>,
    /// Lossless colour while the view moves, too
    #[arg(long)]
    pub(crate) lossless: bool,
    /// Draw annotations: all, or sets by their names with commas between them; A places landmarks
    /// then, and 1 takes them back
    #[arg(long, value_name = "true|SETS", value_parser = ShownSets::parse)]
    pub(crate) annotations: Option<ShownSets>,
    /// Author of placed annotations
    #[arg(long, value_name = "NAME", env = "RELIEF_AUTHOR")]
    pub(crate) author: Option<String>,
    /// Wait for a server or a volume that is not there yet; the default without --save-frame,
    /// --measure and --replay
    #[arg(long, conflicts_with = "no_wait")]
    wait: bool,
    /// End when the server or the volume is not there yet; the default with --save-frame, --measure
    /// and --replay
    #[arg(long)]
    no_wait: bool,
    #[command(flatten)]
    pub(crate) remote: RemoteArguments,
    #[command(flatten)]
    pub(crate) pointer: PointerArguments,
    #[command(flatten)]
    pub(crate) eyes: EyesArguments,
    #[command(flatten)]
    pub(crate) headless: HeadlessArguments,
    #[command(flatten)]
    pub(crate) recording: RecordArguments,
    /// Play a recorded session, and compare its still pictures
    #[arg(long, value_name = "FILE", conflicts_with_all = ["measure", "look"])]
    pub(crate) replay: Option<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    pub(crate) json: bool,
    #[cfg(feature = "window")]
    #[command(flatten)]
    pub(crate) window: WindowArguments,
}

#[derive(Debug, clap::Args)]
pub(crate) struct RecordArguments {
    /// Record the session: messages and hashes of frames as JSON lines, or the frames as a film without
    /// loss (.mkv, .mp4), 25 a second
    #[arg(long, value_name = "FILE", conflicts_with_all = ["measure", "replay"])]
    pub(crate) record: Option<PathBuf>,
    /// Codec of a film: h264, without loss in RGB, or ffv1, for archives in .mkv
    #[arg(long, value_name = "NAME", default_value = "h264", requires = "record")]
    pub(crate) codec: FilmCodec,
    /// The ffmpeg to use
    #[arg(long, value_name = "PATH", env = "RELIEF_FFMPEG", default_value = "ffmpeg")]
    pub(crate) ffmpeg: PathBuf,
}

#[derive(Debug, clap::Args)]
pub(crate) struct HeadlessArguments {
    /// Open no window
    #[arg(long)]
    pub(crate) headless: bool,
    /// Move the view for so long, and tell how quick the server is
    #[arg(long, value_name = "SECONDS", requires = "headless", value_parser = seconds)]
    pub(crate) measure: Option<f64>,
    /// Clients that measure; with --view they share one that the first of them moves
    #[arg(long, value_name = "N", requires = "measure", default_value_t = 1, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub(crate) clients: u16,
    /// Clients beside them that take nothing, or acknowledge nothing
    #[arg(long, value_name = "M", requires = "measure", default_value_t = 0, value_parser = clap::value_parser!(u16).range(0..=1000))]
    pub(crate) stalled: u16,
    /// Poses a second
    #[arg(long, value_name = "HZ", requires = "measure", default_value_t = 60, value_parser = clap::value_parser!(u16).range(1..=1000))]
    pub(crate) pose_hz: u16,
    /// Compose every N-th frame and check its header; 0 checks the still frame only
    #[arg(long, value_name = "N", requires = "measure", default_value_t = 1)]
    pub(crate) check_every: u32,
    /// Write the still frame, composed, as PNG
    #[arg(long, value_name = "F.png", requires = "headless")]
    pub(crate) save_frame: Option<PathBuf>,
}

impl ClientArguments {
    /// Whether the client waits for a server or a volume that is not there yet.
    pub(crate) fn waits(&self) -> bool {
        let is_one_task =
            self.headless.save_frame.is_some() || self.headless.measure.is_some() || self.replay.is_some();
        self.wait || !(self.no_wait || is_one_task)
    }

    /// Whether the server is on this machine.
    pub(crate) fn is_local(&self) -> bool {
        let host = self.server.target().0;
        host == "localhost" || host.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
    }
}

const AFTER_HELP: &str = "\
Without --headless a window shows the frames, one pixel of a frame on one pixel of the display. A lost connection is made again,
and the session goes on where it was. After 3 s without a connection the window shows \"waiting for HOST\" in place of the picture.

Mouse: drag turns, right drag shifts, the wheel zooms, Ctrl and click sets the cursor.
Keys: arrows turn, + and - zoom, [ and ] change the preset, Page Up and Page Down cut, space places, U takes back, N next label,
      R resets, F full screen, Q or Escape ends.

Examples:
  relief client --server http://ct-server:8080 --fullscreen --wiimote hidraw --view theatre-1
  RELIEF_TOKEN=... relief client --server https://ct-server:8443 --ca relief-certificate.pem --fullscreen
  relief client --server http://ct-server:8080 --fullscreen --pointer spacemouse
  relief client --server http://ct-server:8080 --fullscreen --pointer igtl:ct-server:18944/StylusToTracker
  relief client --server http://ct-server:8080 --fullscreen --layout lines --size 1920x1080
  relief client --server http://ct-server:8080 --fullscreen --layout lenses-9 --panel panel.json --size 3840x2160
  relief client --server http://127.0.0.1:8080 --headless --role watcher --view theatre-1 --eyes opentrack
  relief client --server http://127.0.0.1:8080 --headless --look 30,10 --save-frame frame.png
  relief client --server http://127.0.0.1:8080 --headless --size 420x560 --record session_qs5x9a0.75.mkv
  relief client --server http://127.0.0.1:8080 --headless --record session.mkv     until Ctrl-C
  relief client --server http://127.0.0.1:8080 --headless --measure 10 --json
  relief client --server http://127.0.0.1:8080 --headless --measure 600 --clients 50 --stalled 50 --view soak --check-every 0";

fn view_name(name: &str) -> Result<String, String> {
    check_view_name(name).map(|()| name.to_owned()).map_err(|error| error.source.to_string())
}

fn parse_screen_plane(text: &str) -> Result<ScreenPlane, String> {
    if text == "cursor" {
        return Ok(ScreenPlane::Cursor);
    }
    let point = parse_triple(text).map(ScreenPlane::PointMm);
    point.map_err(|expected| format!("it is cursor, or {expected}, in mm"))
}

fn profile_name(name: &str) -> Result<ProfileName, String> {
    let names = || ProfileName::ALL.map(ProfileName::name).join(", ");
    let found = ProfileName::ALL.into_iter().find(|profile| profile.name() == name);
    found.ok_or_else(|| format!("displays are {}", names()))
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds: f64 = text.parse().map_err(|error| format!("{error}"))?;
    if (0.1..=3600.0).contains(&seconds) { Ok(seconds) } else { Err("allowed: 0.1 to 3600 s".to_owned()) }
}

fn parse_look(text: &str) -> Result<OrbitPose, String> {
    let numbers: Result<Vec<f64>, _> = text.split(',').map(|part| part.trim().parse::<f64>()).collect();
    match numbers.as_deref() {
        Ok(&[azimuth_deg, elevation_deg]) => Ok(OrbitPose { azimuth_deg, elevation_deg, zoom: None }),
        Ok(&[azimuth_deg, elevation_deg, zoom]) => {
            Ok(OrbitPose { azimuth_deg, elevation_deg, zoom: Some(zoom) })
        }
        _ => Err("a view is AZIMUTH,ELEVATION or AZIMUTH,ELEVATION,ZOOM, such as 30,10,1.4".to_owned()),
    }
}

/// Whether clients show this layout.
fn is_shown(layout: Layout) -> bool {
    LiveLayout::of(layout) != LiveLayout::None || layout.view_count() > 0 && layout != Layout::Wiggle
}

/// How views are made of the server's picture and depth.
#[derive(Debug, clap::Args)]
pub(crate) struct ViewsArguments {
    /// The panel that lenses-N is for: a JSON file of pitch_px, slant, center, subpixels, is_reversed
    /// and view_cone_deg, or the calibration of a Looking Glass
    #[arg(long, value_name = "FILE.json")]
    pub(crate) panel: Option<PathBuf>,
    /// Eye separations between the outermost views: 1 for two views and 2 for more where left out
    #[arg(long, value_name = "EYES")]
    pub(crate) view_span: Option<f64>,
    /// Angle between the outermost views in degrees, in place of --view-span [default: the view cone of
    /// the --panel; 35 for files with the name of a quilt]
    #[arg(long, value_name = "DEG", conflicts_with = "view_span")]
    pub(crate) view_cone: Option<f64>,
    /// Layers that views are made of: 2 fills holes with the surface behind, for twice the data
    /// [default: 1]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..=2))]
    pub(crate) layers: Option<u8>,
    /// The renderer of the views: best, cpu, software, or a part of a graphics adapter's name. `best`
    /// is a graphics card, or else `cpu`; all give the same pixels [default: best]
    #[arg(long, value_name = "NAME")]
    pub(crate) adapter: Option<String>,
}

impl ViewsArguments {
    /// Whether one of them is set.
    pub(crate) fn is_given(&self) -> bool {
        let has_angle = self.view_span.is_some() || self.view_cone.is_some();
        self.panel.is_some() || has_angle || self.layers.is_some() || self.adapter.is_some()
    }
}

/// The role of the client.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Part {
    /// Moves the view
    Presenter,
    /// Looks
    Watcher,
}

/// The side that renders the views of a picture at rest.
#[cfg(feature = "window")]
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum RestChoice {
    /// Rendered by the server, for at most 16 views
    True,
    /// Made by this client
    Synthesised,
}

#[cfg(feature = "window")]
#[derive(Debug, clap::Args)]
pub(crate) struct WindowArguments {
    /// All of the monitor, without borders
    #[arg(long, conflicts_with_all = ["windowed", "headless"])]
    pub(crate) fullscreen: bool,
    /// A window of the frame's size; the default without --fullscreen
    #[arg(long, conflicts_with = "headless")]
    pub(crate) windowed: bool,
    /// The monitor, from 0, from left to right
    #[arg(long, value_name = "N", conflicts_with = "headless")]
    pub(crate) monitor: Option<usize>,
    /// Views of a picture at rest, for layouts of views: true, which the server renders, or
    /// synthesised, which this client makes [default: true]
    #[arg(long, value_enum, value_name = "WHICH", conflicts_with = "headless")]
    pub(crate) rest: Option<RestChoice>,
    /// Never draw marks of state into the picture's lower left corner; a picture that is out of date is
    /// replaced by text even so
    #[arg(long, conflicts_with = "headless")]
    pub(crate) clean: bool,
}
