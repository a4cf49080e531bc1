//! Sets and templates: texts by their name, each change of which is written down.

use std::collections::BTreeMap;

use futures_util::TryStreamExt;
use sqlx::Row;

use super::error::{Damage, StoreError};
use super::rows::{signed, unsigned};
use super::{Store, watch};
use relief_annotation::{Author, Edit, Set, Timestamp};
use relief_base::OutOfRange;

/// Most bytes of a template's text.
const LONGEST_TEMPLATE: usize = 1 << 20;

/// The subject of a row of the audit.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize)]
#[serde(rename_all = "lowercase")]
pub enum AuditedKind {
    /// A set.
    Set,
    /// A template.
    Template,
}

/// The state of a set or template before a change, read in the transaction of the change.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct NamedState {
    /// The stored text; `None` for a new set or template.
    pub text: Option<String>,
    /// The author of its first text.
    pub creator: Option<String>,
    /// Whether a set has items whose author is not the author of the change.
    pub has_items_of_others: bool,
}

/// Whether a set or template may be changed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Permission {
    /// The change is permitted.
    Granted,
    /// The stored text has changed since the author read it.
    Replaced,
    /// The author is not the owner.
    NotOwner,
}

/// A set or template, with its creator.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Audited {
    /// 1 for the first line, one more with every line.
    pub seq: u64,
    /// The subject.
    pub kind: AuditedKind,
    /// The name of that.
    pub name: String,
    /// Its author.
    pub author: Author,
    /// The time.
    pub time: Timestamp,
    /// The text from then on: of a set, its JSON form.
    pub body: String,
}

impl AuditedKind {
    const fn word(self) -> &'static str {
        match self {
            Self::Set => "set",
            Self::Template => "template",
        }
    }
}

impl Store {
    /// All sets by name: those that were put, and those that items name, which have no reader and
    /// are not blinded.
    ///
    /// # Errors
    /// Errors of the database.
    pub async fn sets(&self) -> Result<Vec<Set>, StoreError> {
        let mut transaction = self.begin_read().await?;
        let named = sqlx::query("SELECT DISTINCT set_name FROM items WHERE item IS NOT NULL");
        let named = named.fetch_all(&mut *transaction).await?;
        let put = sqlx::query("SELECT body FROM sets").fetch_all(&mut *transaction).await?;
        let mut sets = BTreeMap::new();
        for row in named {
            let name: String = row.try_get(0)?;
            sets.insert(name.clone(), Set { name, reader: None, blinded: false, template: None });
        }
        for row in put {
            let set: Set = serde_json::from_str(row.try_get(0)?)
                .map_err(|error: serde_json::Error| Damage::SetText { column: error.column() })?;
            sets.insert(set.name.clone(), set);
        }
        Ok(sets.into_values().collect())
    }

    /// Makes a set, or makes it another one.
    ///
    /// # Errors
    /// [`StoreError::Invalid`], and errors of the database.
    pub async fn put_set(&self, set: &Set, author: &str) -> Result<(), StoreError> {
        self.put_set_if(set, author, |_| Permission::Granted).await
    }

    /// Makes or replaces a set if `may` permits it.
    ///
    /// # Errors
    /// [`StoreError::Replaced`] and [`StoreError::NotOwner`] as `may` says, [`StoreError::Invalid`], and errors of
    /// the database.
    pub async fn put_set_if(
        &self,
        set: &Set,
        author: &str,
        may: impl Fn(&NamedState) -> Permission + Send,
    ) -> Result<(), StoreError> {
        Set::check_name(&set.name)?;
        set.template.as_deref().map_or(Ok(()), Set::check_name)?;
        set.reader.as_deref().map_or(Ok(()), |reader| Edit::check_words(reader, ""))?;
        let body = serde_json::to_string(set).map_err(|error| StoreError::Database(error.into()))?;
        self.put(AuditedKind::Set, &set.name, &body, author, may).await
    }

    /// Names of all templates.
    ///
    /// # Errors
    /// Errors of the database.
    pub async fn templates(&self) -> Result<Vec<String>, StoreError> {
        let rows = sqlx::query("SELECT name FROM templates ORDER BY name").fetch_all(&self.read()).await?;
        rows.iter().map(|row| Ok(row.try_get(0)?)).collect()
    }

    /// The text of a template.
    ///
    /// # Errors
    /// [`StoreError::NoTemplate`], and errors of the database.
    pub async fn template(&self, name: &str) -> Result<String, StoreError> {
        let query = sqlx::query("SELECT body FROM templates WHERE name = $1").bind(name);
        match query.fetch_optional(&self.read()).await? {
            Some(row) => Ok(row.try_get(0)?),
            None => Err(StoreError::NoTemplate { name: name.to_owned() }),
        }
    }

    /// Creates a template or replaces its text. The text is not interpreted.
    ///
    /// # Errors
    /// [`StoreError::Invalid`] for an invalid name or a text above 1 MiB, and errors of
    /// the database.
    pub async fn put_template(&self, name: &str, body: &str, author: &str) -> Result<(), StoreError> {
        self.put_template_if(name, body, author, |_| Permission::Granted).await
    }

    /// Creates or replaces a template if `may` permits it.
    ///
    /// # Errors
    /// [`StoreError::Replaced`] and [`StoreError::NotOwner`] as `may` says, and those of
    /// [`Self::put_template`].
    pub async fn put_template_if(
        &self,
        name: &str,
        body: &str,
        author: &str,
        may: impl Fn(&NamedState) -> Permission + Send,
    ) -> Result<(), StoreError> {
        Set::check_name(name).map_err(|error| OutOfRange { path: "template".to_owned(), ..error })?;
        if body.len() > LONGEST_TEMPLATE || body.contains('\0') {
            let found = format!("{} bytes", body.len());
            return Err(OutOfRange::new("template", found, "at most 1 MiB of text").into());
        }
        self.put(AuditedKind::Template, name, body, author, may).await
    }

    /// Every change of sets and templates, the oldest first.
    ///
    /// # Errors
    /// Errors of the database.
    pub async fn audit(&self) -> Result<Vec<Audited>, StoreError> {
        let query = sqlx::query("SELECT seq, kind, name, author, time, body FROM audit ORDER BY seq");
        let rows = query.fetch_all(&self.read()).await?;
        let line = |row: &sqlx::any::AnyRow| {
            let seq = unsigned(row, 0)?;
            let time: String = row.try_get(4)?;
            let is_set = row.try_get::<String, _>(1)? == AuditedKind::Set.word();
            Ok(Audited {
                seq,
                kind: if is_set { AuditedKind::Set } else { AuditedKind::Template },
                name: row.try_get(2)?,
                author: row.try_get(3)?,
                time: time.parse().map_err(|_| Damage::AuditTime { seq })?,
                body: row.try_get(5)?,
            })
        };
        rows.iter().map(line).collect()
    }

    async fn put(
        &self,
        kind: AuditedKind,
        name: &str,
        body: &str,
        author: &str,
        may: impl Fn(&NamedState) -> Permission + Send,
    ) -> Result<(), StoreError> {
        Edit::check_words(author, "")?;
        let (known, upsert) = match kind {
            AuditedKind::Set => (
                "SELECT body FROM sets WHERE name = $1",
                "INSERT INTO sets (name, body) VALUES ($1, $2) ON CONFLICT (name) DO UPDATE SET body = excluded.body",
            ),
            AuditedKind::Template => (
                "SELECT body FROM templates WHERE name = $1",
                "INSERT INTO templates (name, body) VALUES ($1, $2) \
                ON CONFLICT (name) DO UPDATE SET body = excluded.body",
            ),
        };
        let mut transaction = self.begin_write().await?;
        let known = sqlx::query(known).bind(name).fetch_optional(&mut *transaction).await?;
        let text: Option<String> = known.map(|row| row.try_get(0)).transpose()?;
        let first = "SELECT author FROM audit WHERE kind = $1 AND name = $2 ORDER BY seq LIMIT 1";
        let first = sqlx::query(first).bind(kind.word()).bind(name).fetch_optional(&mut *transaction).await?;
        let creator = first.map(|row| row.try_get(0)).transpose()?;
        let has_items_of_others =
            kind == AuditedKind::Set && items_of_others(&mut transaction, name, author).await?;
        match may(&NamedState { text, creator, has_items_of_others }) {
            Permission::Granted => {}
            Permission::Replaced => return Err(StoreError::Replaced { name: name.to_owned() }),
            Permission::NotOwner => return Err(StoreError::NotOwner { name: name.to_owned() }),
        }
        let last =
            sqlx::query("SELECT coalesce(max(seq), 0) FROM audit").fetch_one(&mut *transaction).await?;
        let seq = unsigned(&last, 0)? + 1;
        sqlx::query(
            "INSERT INTO audit (seq, kind, name, author, time, body) VALUES ($1, $2, $3, $4, $5, $6)",
        )
        .bind(signed(seq))
        .bind(kind.word())
        .bind(name)
        .bind(author)
        .bind(Timestamp::now().to_string())
        .bind(body)
        .execute(&mut *transaction)
        .await?;
        sqlx::query(upsert).bind(name).bind(body).execute(&mut *transaction).await?;
        self.announce(&mut transaction, watch::AUDIT, seq).await?;
        Ok(transaction.commit().await?)
    }
}

/// Whether a set has items of other authors.
async fn items_of_others(
    connection: &mut sqlx::AnyConnection,
    set: &str,
    author: &str,
) -> Result<bool, StoreError> {
    let query = "SELECT item FROM items WHERE set_name = $1 AND item IS NOT NULL";
    let mut rows = sqlx::query(query).bind(set).fetch(connection);
    while let Some(row) = rows.try_next().await? {
        let author_of = |item: ItemAuthor| item.author;
        // A damaged item counts as one of another author.
        if serde_json::from_str(row.try_get(0)?).map(author_of).ok().as_deref() != Some(author) {
            return Ok(true);
        }
    }
    Ok(false)
}

#[derive(serde::Deserialize)]
struct ItemAuthor {
    author: String,
}
