//! Rules of the sources, the documents and the manifests.
//!
//! One program for all of them, because linking takes longer than most of its tests.

mod documents;
mod house_rules;
mod kubernetes;
