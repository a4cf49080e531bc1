//! The log of annotations: an append-only table of events in SQLite or PostgreSQL, and what follows from it.
//!
//! What it is not: it knows no HTTP and no voxels.
