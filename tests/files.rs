//! Files in and out: DICOM, annotations, label maps, studies of readers, and the commands that read
//! and write them.
//!
//! One program for all of them, because linking takes longer than most of its tests.

mod cli;
mod common;
mod convert;
mod dicom;
mod dicom_objects;
mod exchange;
mod hostile;
mod label_files;
mod readers;
