//! Intents of users, from any input device, and their effects on a view.
//!
//! This is arithmetic on [`Intent`]s. A [`ViewState`] applies one after another and gives the
//! [`relief_volume::Camera`], clip plane, preset and cursor of the next picture. It reads no device
//! and no clock, opens no socket and renders nothing: times are parameters in ns, pictures are
//! parameters of type [`DisplayedPicture`].
//!
//! | space | definition |
//! |---|---|
//! | view axes | x right, y up, z towards the viewer, mm; the focal point is 0 |
//! | `Patient` | DICOM LPS, mm |
//! | pixels | u right, v down, centres at +0.5, of the picture's full size |
//!
//! Devices say the same in the same words; [`Gestures`] has the Wiimote's, clients keep to the
//! others:
//!
//! | what | intent | Wiimote | mouse | touch | keys | gamepad |
//! |---|---|---|---|---|---|---|
//! | turn about the patient | `orbit` | | drag | one finger | arrows | left stick |
//! | turn and move freely | `grab`, `move`, `release` | hold B | | | | |
//! | turn freely | `turn` | | Alt + drag | two fingers, twisted | | shoulders |
//! | shift | `pan` | | Shift + drag, right drag | two fingers | Shift + arrows | right stick |
//! | closer, farther | `zoom` | +, - | wheel | pinch | +, - | triggers |
//! | clip plane | `clip` | cross up, down | Ctrl + wheel | | Page Up, Page Down | cross up, down |
//! | preset | `preset` | cross left, right | | | 1 to 9 | cross left, right |
//! | cursor | `cursor` | the tip | pointer | tap | | |
//! | place | `place` | A: press previews, release commits | Ctrl + click | long press | Enter | A |
//! | move what is placed | `place` | A near it: it goes with the tip to where A is released | | | | |
//! | undo | `undo` | 1 | | | Ctrl + Z | B |
//! | next label | `next_label` | 2 | | | L | Y |
//! | home | `reset` | home | double click | | Home, 0 | start |
//!
//! ```
//! use relief_base::Point;
//! use relief_live::{Home, Intent, Stage, ViewState};
//! use relief_volume::Orbit;
//!
//! let presets = vec!["bone".to_owned(), "skin".to_owned()];
//! let home = Home { orbit: Home::ORBIT, preset: Some("bone".to_owned()) };
//! let stage = Stage::new(Point::new(0.0, 0.0, 0.0), 200.0, [960, 540], presets, home)?;
//! let mut view = ViewState::home(&stage);
//! let intent = Intent::from_json(br#"{"intent":"orbit","azimuth_deg":30}"#)?;
//! view.apply(&stage, 0, &intent, None)?;
//! let wanted = Orbit { azimuth_deg: 50.0, ..Home::ORBIT }.camera(stage.center(), stage.radius_mm())?;
//! assert!(view.camera(&stage)?.eye().distance(wanted.eye()) < 1e-9);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod apply;
mod aspect;
mod gestures;
mod grab;
mod hand;
mod intent;
mod spacemouse;
mod stage;
mod view;

pub use apply::{AppliedIntent, IntentEffect};
pub use gestures::Gestures;
pub use hand::{HandOptions, HandPose, HandSample};
pub use intent::{GrabMode, Intent, IntentError, Pivot, PlacePhase};
pub use spacemouse::{SPACENAV_EVENT_BYTES, SpaceMouseEvent};
pub use stage::{Home, Stage};
pub use view::{CursorMark, CutPlane, DisplayedPicture, ViewRecord, ViewState};
