//! The Wiimote as a six-degree-of-freedom pointer: from reports to poses.
//!
//! A Wiimote's infrared camera sees the LEDs of a beacon whose layout is known. [`report`] turns its reports into
//! blobs, acceleration and angular rates; [`sensor`] is the camera, [`Beacon`] what it looks at; [`solve`] finds
//! the [`pose`] that explains a view, [`correspondence`] which blob is which LED, [`filter`] joins poses over time, and
//! [`tracker`] does all of it. [`host`] brings a remote's camera up, [`simulate`] makes
//! recordings, [`igtl`] writes poses for others. Everything here is arithmetic on numbers that came from outside: no
//! sockets, no threads, no clock.
//!
//! | space | definition |
//! |---|---|
//! | `Beacon` | the LED rig, mm; `up` is the direction that gravity pulls away from |
//! | `Sensor` | the Wiimote's camera, mm: x right, y down, z forward |
//! | pixels | u right, v down, 1024 x 768; the raw y of reports points up, v = 767 - y |

mod beacon;
pub mod calibrate;
pub mod correspondence;
pub mod design;
pub mod experiment;
pub mod filter;
pub mod host;
pub mod igtl;
pub mod pose;
pub mod report;
pub mod sensor;
pub mod simulate;
pub mod solve;
pub mod tracker;

pub use beacon::{Beacon, BeaconError, MAX_LEDS, MIN_LEDS};
