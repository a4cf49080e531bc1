//! Where something is set down: a picked or pointed place, moved to the surface, edge or extremum that was meant.
//!
//! What it is not: it reads no device and renders nothing. Space: patient LPS, mm; values in HU.
