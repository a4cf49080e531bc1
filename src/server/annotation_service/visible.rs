//! The sets that an author may see, and into which the author may write.
//!
//! A blinded set is visible to its reader only, and a reader of blinded sets sees only those, so
//! that readers do not influence each other. A set that names a reader is writable by that reader
//! only; other sets are writable by all.

use axum::http::StatusCode;

use crate::problem::Problem;
use relief_annotation::Set;

/// The sets as one author sees them.
pub(crate) struct Visible<'a> {
    sets: &'a [Set],
    author: Option<&'a str>,
    /// Whether the author reads blinded sets.
    is_blinded: bool,
}

impl<'a> Visible<'a> {
    pub(crate) fn new(sets: &'a [Set], author: Option<&'a str>) -> Self {
        let is_blinded =
            sets.iter().any(|set| set.blinded && author.is_some() && set.reader.as_deref() == author);
        Self { sets, author, is_blinded }
    }

    /// Whether the author sees items of this set.
    pub(crate) fn sees(&self, name: &str) -> bool {
        match self.sets.iter().find(|set| set.name == name) {
            Some(set) if set.blinded => self.author.is_some() && set.reader.as_deref() == self.author,
            _ => !self.is_blinded,
        }
    }

    /// Checks that the author may write into this set.
    pub(crate) fn expect_writable(&self, name: &str) -> Result<(), Problem> {
        let reader = self.sets.iter().find(|set| set.name == name).and_then(|set| set.reader.as_deref());
        if self.sees(name) && reader.is_none_or(|reader| Some(reader) == self.author) {
            return Ok(());
        }
        let detail = "the set is another reader's, or blinded; write into one of your own";
        Err(Problem::new(StatusCode::FORBIDDEN, "not-your-set", detail).with("path", "set"))
    }

    /// The sets that the author sees, those without items among them.
    pub(crate) fn sets(&self) -> impl Iterator<Item = &'a Set> {
        self.sets.iter().filter(|set| self.sees(&set.name))
    }

    /// The set for new items where the request names none: the first set whose reader is the
    /// author, or else the default set.
    pub(crate) fn own(&self) -> &'a str {
        let is_own = |set: &&Set| set.reader.is_some() && set.reader.as_deref() == self.author;
        self.sets().find(is_own).map_or(Set::DEFAULT, |set| &set.name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn set(name: &str, reader: Option<&str>, blinded: bool) -> Set {
        Set { name: name.to_owned(), reader: reader.map(str::to_owned), blinded, template: None }
    }

    #[test]
    fn a_blinded_reader_sees_only_its_own_set_and_others_do_not_see_it() {
        let sets = [set("a", Some("anna"), true), set("b", Some("ben"), true), set("c", Some("cleo"), false)];
        for (author, seen, written) in [
            (Some("anna"), &["a"][..], &["a"][..]),
            (Some("ben"), &["b"], &["b"]),
            (Some("cleo"), &["c", "default"], &["c", "default"]),
            (Some("dora"), &["c", "default"], &["default"]),
            (None, &["c", "default"], &["default"]),
        ] {
            let visible = Visible::new(&sets, author);
            let names = ["a", "b", "c", "default"];
            let sees: Vec<_> = names.into_iter().filter(|name| visible.sees(name)).collect();
            let writes: Vec<_> =
                names.into_iter().filter(|name| visible.expect_writable(name).is_ok()).collect();
            assert_eq!((sees.as_slice(), writes.as_slice()), (seen, written), "{author:?}");
        }
        assert_eq!(
            [Some("anna"), Some("cleo"), None].map(|who| Visible::new(&sets, who).own()),
            ["a", "c", "default"]
        );
        let nobodys = [set("x", None, true)];
        assert!(!Visible::new(&nobodys, None).sees("x"), "a blinded set without a reader is hidden");
    }
}
