//! Changes as values: wanted ones ([`Edit`]) and those that were made ([`Event`]).

use relief_base::OutOfRange;
use serde::{Deserialize, Serialize};

use super::item::{Item, ItemId};
use super::time::Timestamp;

/// The author of a change: a name of 1 to 120 characters.
pub type Author = String;

/// Changes that happen together or not at all, and are undone together.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Edit {
    /// The author.
    pub author: Author,
    /// Why; may be empty.
    #[serde(default)]
    pub reason: String,
    /// In order. At most one for each item.
    pub changes: Vec<Change>,
}

/// One wanted change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "change", rename_all = "lowercase", deny_unknown_fields)]
pub enum Change {
    /// A new item.
    Create {
        /// The item, with an id that was never used.
        item: Box<Item>,
    },
    /// An item becomes another one.
    Update {
        /// The new state of the item with this id.
        item: Box<Item>,
        /// The version that the author saw.
        version: u64,
    },
    /// An item goes.
    Delete {
        /// The item.
        id: ItemId,
        /// The version that the author saw.
        version: u64,
    },
}

/// An item with the number of its changes.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Versioned {
    /// 1 for a new item, one more with every event.
    pub version: u64,
    /// The item.
    pub item: Item,
}

/// The kind of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum EventKind {
    /// An edit was made.
    Do,
    /// It was taken back.
    Undo,
    /// It was made again.
    Redo,
}

/// One change of one item as it was made.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Event {
    /// 1 for the first of the log, one more with every event.
    pub seq: u64,
    /// The edit that it is part of: the `seq` of the edit's first event.
    pub edit: u64,
    /// The kind of the event.
    pub kind: EventKind,
    /// Of an undo or redo: the edit that it takes back or makes again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub target: Option<u64>,
    /// The item.
    pub id: ItemId,
    /// The item's version after it.
    pub version: u64,
    /// The author.
    pub author: Author,
    /// Why; may be empty.
    pub reason: String,
    /// The time, by the clock of the machine that keeps the log.
    pub time: Timestamp,
    /// The item after it; `None` where it went.
    pub item: Option<Item>,
}

impl Change {
    /// The item that changes.
    #[must_use]
    pub fn id(&self) -> ItemId {
        match self {
            Self::Create { item } | Self::Update { item, .. } => item.id,
            Self::Delete { id, .. } => *id,
        }
    }
}

impl Edit {
    /// Most changes of an edit.
    pub const MOST_CHANGES: usize = 100_000;
    /// Most characters of a reason.
    pub const LONGEST_REASON: usize = 1000;

    /// Checks an author's name, and a reason.
    ///
    /// # Errors
    /// When the name is empty, long or of several lines, or the reason is long or has control
    /// characters but those of lines.
    pub fn check_words(author: &str, reason: &str) -> Result<(), OutOfRange> {
        let characters = author.chars().count();
        if !(1..=Item::LONGEST_NAME).contains(&characters) || author.contains(char::is_control) {
            let allowed = format!("1 to {} characters in one line", Item::LONGEST_NAME);
            return Err(OutOfRange::new("author", format!("{characters} characters"), allowed));
        }
        let characters = reason.chars().count();
        let is_odd = |letter: char| letter.is_control() && !"\n\r\t".contains(letter);
        if characters > Self::LONGEST_REASON || reason.contains(is_odd) {
            let allowed = format!("at most {} characters of text", Self::LONGEST_REASON);
            return Err(OutOfRange::new("reason", format!("{characters} characters"), allowed));
        }
        Ok(())
    }

    /// Checks author, reason and every item.
    ///
    /// # Errors
    /// The first value that is wrong, with its path.
    pub fn validate(&self) -> Result<(), OutOfRange> {
        Self::check_words(&self.author, &self.reason)?;
        if !(1..=Self::MOST_CHANGES).contains(&self.changes.len()) {
            let found = format!("{} changes", self.changes.len());
            return Err(OutOfRange::new("changes", found, format!("1 to {}", Self::MOST_CHANGES)));
        }
        let mut known = std::collections::HashSet::new();
        for (index, change) in self.changes.iter().enumerate() {
            if !known.insert(change.id()) {
                let path = format!("changes[{index}].id");
                return Err(OutOfRange::new(path, change.id(), "one change for each item"));
            }
            if let Change::Create { item } | Change::Update { item, .. } = change {
                item.validate().map_err(|error| error.within(&format!("changes[{index}].item")))?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_edit_names_the_change_that_is_wrong() {
        let item = Item::new("a", "anna", None).unwrap();
        let create = |item: &Item| Change::Create { item: Box::new(item.clone()) };
        let edit = |changes| Edit { author: "anna".to_owned(), reason: String::new(), changes };
        edit(vec![create(&item)]).validate().unwrap();
        let bad = Item { name: String::new(), ..Item::new("b", "anna", None).unwrap() };
        let refused = edit(vec![create(&item), create(&bad)]).validate().unwrap_err();
        assert_eq!(refused.path, "changes[1].item.name");
        let twice = edit(vec![create(&item), Change::Delete { id: item.id, version: 1 }]);
        assert_eq!(twice.validate().unwrap_err().path, "changes[1].id");
        assert_eq!(edit(vec![]).validate().unwrap_err().path, "changes");
        assert_eq!(
            Edit { author: String::new(), ..edit(vec![create(&item)]) }.validate().unwrap_err().path,
            "author"
        );
    }
}
