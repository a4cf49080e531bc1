//! Items and events as clients see them: without the frame of reference, which is a UID, and the
//! volume's anyway.

use serde_json::{Value, json};

use relief_annotation::{Event, Geometry, Item, Versioned, measures};

/// An item for clients.
pub(crate) fn outward_item(item: &Item) -> Value {
    json!(Item { frame_of_reference: None, ..item.clone() })
}

/// An item with its version and measures.
pub(crate) fn outward_versioned(versioned: &Versioned) -> Value {
    json!({
        "version": versioned.version,
        "item": outward_item(&versioned.item),
        "measures": measures_of(versioned.item.geometry.as_ref()),
    })
}

/// An event, with the set of its item.
pub(crate) fn outward_event(event: &Event, set: &str) -> Value {
    let item = event.item.as_ref().map(|item| Item { frame_of_reference: None, ..item.clone() });
    let mut value = json!(Event { item, ..event.clone() });
    value["set"] = set.into();
    value
}

pub(crate) fn measures_of(geometry: Option<&Geometry>) -> Value {
    json!(geometry.map(measures).unwrap_or_default())
}
