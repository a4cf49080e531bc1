//! `relief track` and `relief calibrate`, beside other solvers and libraries, a remote that a
//! kernel plays, and a kernel's pointer.

mod command;
mod cwiid;
#[cfg(target_os = "linux")]
mod kernel;
mod peers;
#[cfg(target_os = "linux")]
mod uhid;
#[cfg(target_os = "linux")]
mod uinput;
