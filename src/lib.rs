//! Relief: headless CT volume rendering, in colour and depth, for glasses-free 3D displays.
//!
//! A CT series becomes a [`volume::Volume`] in HU and patient millimetres; a render request becomes a picture with
//! a view depth for every pixel; both become a 2D-plus-depth frame that a display takes. Data flows one way, and
//! modules import only from ranks below their own:
//!
//! | rank | modules |
//! |---|---|
//! | 0 | [`units`], [`space`] |
//! | 1 | [`volume`], [`transfer`], [`camera`], [`tracking`], [`annotation`] |
//! | 2 | [`gpu`], [`dicom`], [`formats`], [`display`], [`interaction`], [`mesh`], [`segmentation`], [`placing`], [`store`] |
//! | 3 | [`render`], [`live`], [`exchange`] |
//! | 4 | [`session`] |
//! | 5 | [`server`], [`client`], [`batch`] |
//! | 6 | [`cli`] |
//!
//! `ARCHITECTURE.md` has the map and the invariants, each with the test that keeps it.

pub mod annotation;
pub mod batch;
pub mod camera;
pub mod cli;
pub mod client;
pub mod dicom;
pub mod display;
pub mod exchange;
pub mod formats;
pub mod gpu;
pub mod interaction;
pub mod live;
pub mod mesh;
pub mod placing;
pub mod render;
pub mod segmentation;
pub mod server;
pub mod session;
pub mod space;
pub mod store;
pub mod tracking;
pub mod transfer;
pub mod units;
pub mod volume;
