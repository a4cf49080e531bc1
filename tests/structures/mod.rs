//! Structures: regions grown, painted and filled, their surfaces, and meshes as files, against
//! closed forms and peers.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on stops")]
#![expect(clippy::print_stderr, reason = "a test that cannot run says so aloud")]

use crate::common;

mod command;
mod damage;
mod growing;
mod peers;
mod real;
mod shapes;
mod surfaces;
