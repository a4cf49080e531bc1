//! Annotations in the files of other tools, both ways.
//!
//! What it is not: it keeps nothing (see `store`). Space: patient LPS, mm; formats in RAS are mirrored at the edge.
