//! The bytes of frames: disparity, header, layouts, filters, views, files, and their readers.

mod curve;
mod declipse;
mod files;
mod filters;
mod header;
mod inspect;
mod layouts;
mod settings;
mod views;
