//! `relief track` and `relief calibrate`, beside other solvers and libraries, and a remote that the
//! kernel plays.

mod command;
mod cwiid;
mod peers;
mod uhid;
