//! Content items of a report (PS3.3 C.17.3), to be put together.

use dicom_core::value::{C, PrimitiveValue};
use dicom_core::{DataElement, VR};
use dicom_dictionary_std::tags;
use dicom_object::InMemDicomObject;
use glam::DVec3;

use crate::object::{Code, decimal_string, put, put_items};
use crate::reference::Instance;

pub(super) const CONTAINS: &str = "CONTAINS";
pub(super) const CONTEXT: &str = "HAS OBS CONTEXT";
pub(super) const MODIFIER: &str = "HAS CONCEPT MOD";
pub(super) const ACQUISITION: &str = "HAS ACQ CONTEXT";
pub(super) const INFERRED: &str = "INFERRED FROM";

/// A content item with those below it.
pub(super) struct Content {
    item: InMemDicomObject,
    below: Vec<InMemDicomObject>,
}

impl Content {
    /// The relationship is to the item above; the root has none.
    fn new(relationship: Option<&str>, kind: &str, name: Option<Code>) -> Self {
        let mut item = InMemDicomObject::new_empty();
        if let Some(relationship) = relationship {
            put(&mut item, tags::RELATIONSHIP_TYPE, VR::CS, relationship);
        }
        put(&mut item, tags::VALUE_TYPE, VR::CS, kind);
        if let Some(name) = name {
            put_items(&mut item, tags::CONCEPT_NAME_CODE_SEQUENCE, vec![name.item()]);
        }
        Self { item, below: Vec::new() }
    }

    /// The root: its elements go into the object itself.
    pub(super) fn root(name: Code, template: &str) -> Self {
        let mut root = Self::new(None, "CONTAINER", Some(name));
        root.put_template(template);
        root
    }

    pub(super) fn container(name: Code) -> Self {
        let mut container = Self::new(Some(CONTAINS), "CONTAINER", Some(name));
        put(&mut container.item, tags::CONTINUITY_OF_CONTENT, VR::CS, "SEPARATE");
        container
    }

    pub(super) fn group(name: Code, template: &str) -> Self {
        let mut group = Self::container(name);
        group.put_template(template);
        group
    }

    fn put_template(&mut self, template: &str) {
        put(&mut self.item, tags::CONTINUITY_OF_CONTENT, VR::CS, "SEPARATE");
        let mut item = InMemDicomObject::new_empty();
        put(&mut item, tags::MAPPING_RESOURCE, VR::CS, "DCMR");
        put(&mut item, tags::TEMPLATE_IDENTIFIER, VR::CS, template);
        put_items(&mut self.item, tags::CONTENT_TEMPLATE_SEQUENCE, vec![item]);
    }

    pub(super) fn code(relationship: &str, name: Code, value: InMemDicomObject) -> Self {
        let mut content = Self::new(Some(relationship), "CODE", Some(name));
        put_items(&mut content.item, tags::CONCEPT_CODE_SEQUENCE, vec![value]);
        content
    }

    pub(super) fn text(relationship: &str, name: Code, text: &str) -> Self {
        let mut content = Self::new(Some(relationship), "TEXT", Some(name));
        put(&mut content.item, tags::TEXT_VALUE, VR::UT, text);
        content
    }

    pub(super) fn person(relationship: &str, name: Code, person: &str) -> Self {
        let mut content = Self::new(Some(relationship), "PNAME", Some(name));
        put(&mut content.item, tags::PERSON_NAME, VR::PN, person);
        content
    }

    pub(super) fn uid(relationship: &str, name: Code, uid: &str) -> Self {
        let mut content = Self::new(Some(relationship), "UIDREF", Some(name));
        put(&mut content.item, tags::UID, VR::UI, uid);
        content
    }

    pub(super) fn number(name: Code, value: f64, unit: Code) -> Self {
        let mut content = Self::new(Some(CONTAINS), "NUM", Some(name));
        let mut measured = InMemDicomObject::new_empty();
        put(&mut measured, tags::NUMERIC_VALUE, VR::DS, &decimal_string(value));
        let exact = PrimitiveValue::from(value);
        measured.put_element(DataElement::new(tags::FLOATING_POINT_VALUE, VR::FD, exact));
        put_items(&mut measured, tags::MEASUREMENT_UNITS_CODE_SEQUENCE, vec![unit.item()]);
        put_items(&mut content.item, tags::MEASURED_VALUE_SEQUENCE, vec![measured]);
        content
    }

    pub(super) fn image(instance: &Instance) -> Self {
        let mut content = Self::new(Some(CONTAINS), "IMAGE", None);
        put_items(&mut content.item, tags::REFERENCED_SOP_SEQUENCE, vec![instance.reference(None)]);
        content
    }

    /// Coordinates in patient mm, as 32-bit floats.
    pub(super) fn coordinates(
        relationship: &str,
        name: Code,
        graphic: &str,
        points: &[DVec3],
        frame_of_reference: &str,
    ) -> Self {
        let mut content = Self::new(Some(relationship), "SCOORD3D", Some(name));
        put(&mut content.item, tags::GRAPHIC_TYPE, VR::CS, graphic);
        let data: C<f32> = points.iter().flat_map(DVec3::to_array).map(|mm| mm as f32).collect();
        content.item.put_element(DataElement::new(tags::GRAPHIC_DATA, VR::FL, PrimitiveValue::F32(data)));
        put(&mut content.item, tags::REFERENCED_FRAME_OF_REFERENCE_UID, VR::UI, frame_of_reference);
        content
    }

    /// The moment at which it was observed: `YYYYMMDDHHMMSS.FFF+0000`.
    pub(super) fn observed(mut self, moment: &str) -> Self {
        put(&mut self.item, tags::OBSERVATION_DATE_TIME, VR::DT, moment);
        self
    }

    pub(super) fn with(mut self, below: impl IntoIterator<Item = Self>) -> Self {
        self.below.extend(below.into_iter().map(Self::build));
        self
    }

    pub(super) fn build(mut self) -> InMemDicomObject {
        if !self.below.is_empty() {
            put_items(&mut self.item, tags::CONTENT_SEQUENCE, self.below);
        }
        self.item
    }
}
