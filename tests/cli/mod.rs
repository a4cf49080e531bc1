//! Commands that are small: what they print, write and refuse.

mod annotate_log;
mod budget;
mod doctor;
mod labels;
mod light;
mod output;
mod phantom;
mod slices;
mod views;
