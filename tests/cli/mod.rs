//! Small commands: output, files and errors.

mod against_true;
mod annotate_log;
mod budget;
mod doctor;
mod first_look;
mod labels;
mod light;
mod output;
mod phantom;
mod processor;
mod slices;
mod views;
