//! Golden images: those of this repository, the command that checks them, and the comparison tried
//! on itself.

mod command;
mod pictures;
mod selfcheck;
