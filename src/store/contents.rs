//! Bytes that items name: the voxels of regions, the triangles of meshes.

use sqlx::Row;

use super::Store;
use super::error::{Damage, StoreError};
use super::rows::unsigned;
use relief_annotation::ContentId;
use relief_base::OutOfRange;

/// The largest value that both databases take, with some room.
const MOST_BYTES: usize = 900_000_000;

impl Store {
    /// Stores bytes, and returns their name. The same bytes are kept once, with the media type that
    /// they came with first.
    ///
    /// # Errors
    /// [`StoreError::Invalid`] for more bytes than a database accepts or an invalid media
    /// type, and errors of the database.
    pub async fn put_content(&self, media_type: &str, bytes: &[u8]) -> Result<ContentId, StoreError> {
        if bytes.len() > MOST_BYTES {
            let (found, allowed) = (format!("{} bytes", bytes.len()), format!("at most {MOST_BYTES}"));
            return Err(OutOfRange::new("content", found, allowed).into());
        }
        let is_good = |letter: u8| letter.is_ascii_graphic() || letter == b' ';
        if !(1..=200).contains(&media_type.len()) || !media_type.bytes().all(is_good) {
            let found = format!("{} bytes", media_type.len());
            return Err(OutOfRange::new("media_type", found, "1 to 200 letters of ASCII").into());
        }
        let id = ContentId::of(bytes);
        let mut transaction = self.begin_write().await?;
        // Two statements: an existing row is not sent again.
        let query = sqlx::query("SELECT count(*) FROM contents WHERE id = $1").bind(id.as_str());
        let found: i64 = query.fetch_one(&mut *transaction).await?.try_get(0)?;
        if found == 0 {
            sqlx::query("INSERT INTO contents (id, media_type, bytes) VALUES ($1, $2, $3)")
                .bind(id.as_str())
                .bind(media_type)
                .bind(bytes.to_vec())
                .execute(&mut *transaction)
                .await?;
        }
        transaction.commit().await?;
        Ok(id)
    }

    /// Bytes of all contents and of all versions of sets and templates. The log keeps all of them.
    ///
    /// # Errors
    /// Errors of the database.
    pub async fn content_bytes(&self) -> Result<u64, StoreError> {
        let sum = "SELECT CAST((SELECT coalesce(sum(length(bytes)), 0) FROM contents) \
            + (SELECT coalesce(sum(length(body)), 0) FROM audit) AS BIGINT)";
        let row = sqlx::query(sum).fetch_one(&self.read()).await?;
        unsigned(&row, 0)
    }

    /// Media type and bytes of a content, verified by their SHA-256.
    ///
    /// # Errors
    /// [`StoreError::Content`] when it does not exist, [`StoreError::Damaged`], and errors
    /// of the database.
    pub async fn content(&self, id: &ContentId) -> Result<(String, Vec<u8>), StoreError> {
        let query = sqlx::query("SELECT media_type, bytes FROM contents WHERE id = $1").bind(id.as_str());
        let row = query.fetch_optional(&self.read()).await?;
        let row = row.ok_or_else(|| StoreError::Content { id: id.clone() })?;
        let bytes: Vec<u8> = row.try_get(1)?;
        if ContentId::of(&bytes) != *id {
            return Err(Damage::Content { id: id.as_str().to_owned() }.into());
        }
        Ok((row.try_get(0)?, bytes))
    }
}
