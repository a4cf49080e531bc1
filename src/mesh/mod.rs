//! Triangle meshes: surfaces of label maps, made smooth and light, measured, and as files.
//!
//! What it is not: it renders nothing (see `render::overlay`), and fits no shapes. Space: patient LPS, mm.
