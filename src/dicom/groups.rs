//! Functional groups of enhanced objects: attributes shared by all frames or given per frame (PS3.3
//! C.7.6.16).

use dicom_core::Tag;
use dicom_dictionary_std::tags;

use super::attributes::PER_FRAME;
use super::dataset::DataSet;
use super::error::Defect;

/// The functional groups of an object; a classic one is its own only group.
pub(super) struct Groups<'a> {
    pub(super) top: &'a DataSet,
    shared: Option<&'a DataSet>,
    per_frame: &'a [DataSet],
}

impl<'a> Groups<'a> {
    pub(super) fn new(top: &'a DataSet, frames: u32) -> Result<Self, Defect> {
        let shared = top.items(tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE).first();
        let per_frame = top.items(tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE);
        if !per_frame.is_empty() && per_frame.len() != frames as usize {
            return Err(Defect::Attribute {
                attribute: PER_FRAME,
                found: format!("{} items", per_frame.len()),
                expected: "one for each frame",
            });
        }
        Ok(Self { top, shared, per_frame })
    }

    /// The data set that holds `wanted` for a frame: the macro's item per frame, else shared, else
    /// the top level.
    pub(super) fn find(&self, frame: u32, group: Tag, wanted: Tag) -> &'a DataSet {
        let per_frame = self.per_frame.get(frame as usize);
        let items = per_frame.into_iter().chain(self.shared).filter_map(|groups| groups.items(group).first());
        items.into_iter().find(|item| item.bytes(wanted).is_some()).unwrap_or(self.top)
    }

    pub(super) fn plane_position(&self, frame: u32) -> &'a DataSet {
        self.find(frame, tags::PLANE_POSITION_SEQUENCE, tags::IMAGE_POSITION_PATIENT)
    }

    pub(super) fn plane_orientation(&self, frame: u32) -> &'a DataSet {
        self.find(frame, tags::PLANE_ORIENTATION_SEQUENCE, tags::IMAGE_ORIENTATION_PATIENT)
    }

    pub(super) fn measures(&self, frame: u32) -> &'a DataSet {
        self.find(frame, tags::PIXEL_MEASURES_SEQUENCE, tags::PIXEL_SPACING)
    }

    pub(super) fn transformation(&self, frame: u32, wanted: Tag) -> &'a DataSet {
        self.find(frame, tags::PIXEL_VALUE_TRANSFORMATION_SEQUENCE, wanted)
    }
}
