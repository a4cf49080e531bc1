//! The owners of sets and templates, who may change their descriptions.
//!
//! | what | owner |
//! |---|---|
//! | a set with a reader | the reader |
//! | a set with a description and no reader | the author of its first description; a blinded one has no owner |
//! | a set without a description | the author of all of its items; the default set has no owner |
//! | a template | the author of its first text |
//!
//! Owners and administrators may change them. An owner cannot give a set with items of other authors a
//! reader or blind it, because these authors would lose their items. [`Visible`](super::Visible) says who
//! may write items into a set. An open server does not know its callers and allows every change.

use crate::identity::{Identity, Scope};
use relief_annotation::Set;
use relief_store::{NamedState, Permission};

/// The subject of a change.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Named<'a> {
    /// A set, with its new description.
    Set(&'a Set),
    /// A template.
    Template,
}

/// Whether the caller may change a set or template with this state.
pub(crate) fn permission(what: Named<'_>, caller: Option<&Identity>, state: &NamedState) -> Permission {
    let Some(identity) = caller.filter(|identity| identity.scope < Scope::Admin) else {
        return Permission::Granted;
    };
    let is_caller = |name: &Option<String>| name.as_ref() == Some(&identity.name);
    let is_owner = match what {
        Named::Template => state.creator.is_none() || is_caller(&state.creator),
        Named::Set(new) => match state.text.as_deref().map(serde_json::from_str::<Set>) {
            // The stored description is damaged: only an administrator may replace it.
            Some(Err(_)) => false,
            Some(Ok(known)) if known.reader.is_some() => is_caller(&known.reader),
            Some(Ok(known)) => {
                let takes = (&known.reader, known.blinded) != (&new.reader, new.blinded);
                !known.blinded && is_caller(&state.creator) && !(takes && state.has_items_of_others)
            }
            None => new.name != Set::DEFAULT && !state.has_items_of_others,
        },
    };
    if is_owner { Permission::Granted } else { Permission::NotOwner }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identity::Proof;

    fn set(name: &str, reader: Option<&str>, blinded: bool) -> Set {
        Set { name: name.to_owned(), reader: reader.map(str::to_owned), blinded, template: None }
    }

    /// Invariant: Only its owner and administrators change a set or template. An owner cannot take items
    /// away from their authors.
    #[test]
    fn sets_and_templates_are_changed_by_their_owners() {
        let identity =
            |name: &str, scope| Identity { name: name.to_owned(), scope, proof: Proof::Certificate };
        let (anna, ben) = (identity("anna", Scope::Annotate), identity("ben", Scope::Annotate));
        let root = identity("root", Scope::Admin);
        let state = |known: Option<Set>, creator: Option<&str>, has_items_of_others| NamedState {
            text: known.map(|set| serde_json::to_string(&set).unwrap()),
            creator: creator.map(str::to_owned),
            has_items_of_others,
        };
        let by = |new: &Set, state: &NamedState| {
            [Some(&anna), Some(&ben), Some(&root), None]
                .map(|who| permission(Named::Set(new), who, state) == Permission::Granted)
        };
        let read = set("a", Some("anna"), false);
        let taken = set("a", Some("ben"), true);
        for (what, new, state, expected) in [
            (
                "the reader's",
                &taken,
                state(Some(read.clone()), Some("ben"), false),
                [true, false, true, true],
            ),
            ("new", &read, state(None, None, false), [true, true, true, true]),
            ("items of others", &read, state(None, None, true), [false, false, true, true]),
            (
                "blinded, nobody's",
                &read,
                state(Some(set("a", None, true)), Some("anna"), false),
                [false, false, true, true],
            ),
            (
                "shared, made by ben",
                &set("a", None, false),
                state(Some(set("a", None, false)), Some("ben"), true),
                [false, true, true, true],
            ),
            (
                "shared, taken",
                &taken,
                state(Some(set("a", None, false)), Some("ben"), true),
                [false, false, true, true],
            ),
            (
                "the default set",
                &set("default", None, true),
                state(None, None, false),
                [false, false, true, true],
            ),
        ] {
            assert_eq!(by(new, &state), expected, "{what}");
        }
        let template = |who, creator: Option<&str>| {
            permission(Named::Template, Some(who), &state(None, creator, false)) == Permission::Granted
        };
        assert!(template(&anna, None) && template(&anna, Some("anna")) && template(&root, Some("anna")));
        assert!(!template(&ben, Some("anna")));
    }
}
