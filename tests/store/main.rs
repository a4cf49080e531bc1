//! The log of annotations from outside: edits, conflicts, damage, kills and PostgreSQL.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]

mod basics;
mod made;
