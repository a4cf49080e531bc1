//! The property `relief` of JSON formats: the values of an item that the format has no field for.
//!
//! Other tools ignore it when they read and drop it when they write. An item then has only the
//! format's own values.

use serde::{Deserialize, Serialize};

use relief_annotation::{Concept, Item, ItemId, Placement, State, Timestamp};

/// Values without a field in the format. A missing key is a value that the item does not have.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Extra {
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) id: Option<ItemId>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) list: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) order: Option<u32>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) state: Option<State>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) description: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) rgb: Option<[f64; 3]>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) concept: Option<Concept>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) author: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) created: Option<Timestamp>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) placement: Option<Placement>,
    /// Of a curve.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(super) smooth: Option<bool>,
}

impl Extra {
    /// The losses of every format. Each format adds its own.
    pub(super) fn of(item: &Item) -> Self {
        Self {
            id: Some(item.id),
            order: Some(item.order),
            state: (item.state != State::Defined).then_some(item.state),
            rgb: item.rgb,
            concept: item.concept.clone(),
            author: Some(item.author.clone()),
            created: Some(item.created),
            placement: item.placement.clone(),
            ..Self::default()
        }
    }

    /// The item as it was. A place that the file has, or has not, says more than the state that was
    /// written beside it.
    pub(super) fn apply(self, item: &mut Item) {
        item.rgb = self.rgb;
        item.concept = self.concept;
        item.placement = self.placement;
        item.id = self.id.unwrap_or(item.id);
        item.list = self.list.unwrap_or_else(|| std::mem::take(&mut item.list));
        item.order = self.order.unwrap_or(item.order);
        item.author = self.author.unwrap_or_else(|| std::mem::take(&mut item.author));
        item.created = self.created.unwrap_or(item.created);
        item.description = self.description.unwrap_or_else(|| std::mem::take(&mut item.description));
        if item.geometry.is_none() && self.state == Some(State::Skipped) {
            item.state = State::Skipped;
        }
    }
}
