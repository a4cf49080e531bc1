//! `relief track` and `relief calibrate`, beside other solvers and libraries, and a remote that a
//! kernel plays.

mod command;
mod cwiid;
#[cfg(target_os = "linux")]
mod kernel;
mod peers;
#[cfg(target_os = "linux")]
mod uhid;
