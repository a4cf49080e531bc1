//! Structures: regions grown, painted and filled, their surfaces, and meshes as files, against closed forms and peers.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]

mod damage;
mod growing;
mod shapes;
mod surfaces;
