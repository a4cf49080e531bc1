//! Relief: headless CT volume rendering, in colour and depth, for glasses-free 3D displays.

pub use relief_cli as cli;
