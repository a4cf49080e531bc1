//! Structures from annotations: growing from a seed, filling between contours, painting.
//!
//! What it is not: no learning and no thresholds for whole organs; people say where. Spaces: patient LPS mm in, voxels of the
//! volume's grid out.
