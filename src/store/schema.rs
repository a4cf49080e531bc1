//! The tables, the triggers that protect the log, and the settings of every connection.

use sqlx::{AnyConnection, AssertSqlSafe, ConnectOptions, Connection, Executor, Row};

use super::error::{Damage, ForeignFile, StoreError};
use super::faults::StoreFaults;
use super::log_file::LogFile;
use super::place::{DatabaseAddress, DatabaseKind};

/// The newest schema that this version knows, and the one that it makes.
const SCHEMA: u64 = 1;
/// `RELF`: the application id in the head of a SQLite file.
const APPLICATION_ID: i64 = 0x5245_4c46;
/// Holds off others that make the tables in the same database of PostgreSQL.
const MAKING_LOCK: &str = "SELECT pg_advisory_xact_lock(1380273222)";
/// Most attempts of a connection to bring a file into WAL mode while others are busy in it.
const WAL_TRIES: usize = 100;

/// Of both databases; the words in braces differ.
const TABLES: &str = "
CREATE TABLE meta (key TEXT NOT NULL PRIMARY KEY, value TEXT NOT NULL) {strict};
CREATE TABLE contents (id TEXT NOT NULL PRIMARY KEY, media_type TEXT NOT NULL, bytes {bytes} NOT NULL) {strict};
CREATE TABLE events (
  seq {integer} NOT NULL PRIMARY KEY CHECK (seq > 0),
  edit {integer} NOT NULL CHECK (edit BETWEEN 1 AND seq),
  kind TEXT NOT NULL CHECK (kind IN ('do', 'undo', 'redo')),
  target {integer} CHECK ((kind = 'do') = (target IS NULL)),
  id TEXT NOT NULL,
  version {integer} NOT NULL CHECK (version > 0),
  author TEXT NOT NULL CHECK (author <> ''),
  reason TEXT NOT NULL,
  time TEXT NOT NULL,
  item TEXT,
  content TEXT REFERENCES contents (id),
  UNIQUE (id, version)
) {strict};
CREATE INDEX events_by_edit ON events (edit);
CREATE INDEX events_by_author ON events (author, seq);
CREATE TABLE items (
  id TEXT NOT NULL PRIMARY KEY,
  version {integer} NOT NULL,
  seq {integer} NOT NULL UNIQUE REFERENCES events (seq),
  set_name TEXT,
  frame TEXT,
  item TEXT
) {strict};
CREATE INDEX items_by_frame ON items (frame);
CREATE TABLE edits (
  edit {integer} NOT NULL PRIMARY KEY REFERENCES events (seq),
  author TEXT NOT NULL,
  state TEXT NOT NULL CHECK (state IN ('done', 'undone', 'dropped'))
) {strict};
CREATE INDEX edits_by_author ON edits (author, state, edit);
CREATE TABLE sets (name TEXT NOT NULL PRIMARY KEY, body TEXT NOT NULL) {strict};
CREATE TABLE templates (name TEXT NOT NULL PRIMARY KEY, body TEXT NOT NULL) {strict};
CREATE TABLE audit (
  seq {integer} NOT NULL PRIMARY KEY CHECK (seq > 0),
  kind TEXT NOT NULL CHECK (kind IN ('set', 'template')),
  name TEXT NOT NULL,
  author TEXT NOT NULL CHECK (author <> ''),
  time TEXT NOT NULL,
  body TEXT NOT NULL
) {strict};
INSERT INTO meta (key, value) VALUES ('schema', '1');
";

const SQLITE_TRIGGERS: &str = "
CREATE TRIGGER {table}_never_update BEFORE UPDATE ON {table}
BEGIN SELECT RAISE(ABORT, 'lines of {table} are never altered'); END;
CREATE TRIGGER {table}_never_delete BEFORE DELETE ON {table}
BEGIN SELECT RAISE(ABORT, 'lines of {table} never go'); END;
";

const SQLITE_ORDER: &str = "
CREATE TRIGGER events_in_order BEFORE INSERT ON events
WHEN NEW.seq <> (SELECT coalesce(max(seq), 0) + 1 FROM events)
  OR NEW.version <> (SELECT coalesce(max(version), 0) + 1 FROM events WHERE id = NEW.id)
BEGIN SELECT RAISE(ABORT, 'events follow one another without gaps'); END;
CREATE TRIGGER audit_in_order BEFORE INSERT ON audit WHEN NEW.seq <> (SELECT coalesce(max(seq), 0) + 1 FROM audit)
BEGIN SELECT RAISE(ABORT, 'lines of audit follow one another without gaps'); END;
";

const POSTGRES_TRIGGERS: &str = "
CREATE TRIGGER {table}_never_update BEFORE UPDATE OR DELETE OR TRUNCATE ON {table}
FOR EACH STATEMENT EXECUTE FUNCTION relief.never_alter();
";

const POSTGRES_FUNCTIONS: &str = "
CREATE FUNCTION relief.never_alter() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN RAISE EXCEPTION 'lines of % are never altered', TG_TABLE_NAME; END $$;
CREATE FUNCTION relief.event_in_order() RETURNS trigger LANGUAGE plpgsql AS $$
BEGIN
  IF NEW.seq <> (SELECT coalesce(max(seq), 0) + 1 FROM relief.events)
    OR NEW.version <> (SELECT coalesce(max(version), 0) + 1 FROM relief.events WHERE id = NEW.id)
  THEN RAISE EXCEPTION 'events follow one another without gaps'; END IF;
  RETURN NEW;
END $$;
";

const POSTGRES_ORDER: &str = "
CREATE TRIGGER events_in_order BEFORE INSERT ON events FOR EACH ROW EXECUTE FUNCTION relief.event_in_order();
";

/// Tables whose lines stay as they are.
const APPEND_ONLY: [&str; 3] = ["events", "contents", "audit"];

/// Checks that the place has a log of a known schema, and creates one where there is nothing.
///
/// By a connection of its own: a pool tries again and again where one fails, and does not say why.
pub(super) async fn prepare(place: &DatabaseAddress) -> Result<Option<LogFile>, StoreError> {
    let mut connection = place.options.connect().await?;
    let prepared = match place.kind {
        DatabaseKind::Sqlite => prepare_sqlite(&mut connection, place.read_only).await.map(Some),
        DatabaseKind::Postgres => prepare_postgres(&mut connection).await.map(|()| None),
    };
    // The schema is committed; an error on closing does not change it.
    let _ = connection.close().await;
    prepared
}

async fn prepare_sqlite(connection: &mut AnyConnection, read_only: bool) -> Result<LogFile, StoreError> {
    connection.execute("PRAGMA busy_timeout = 30000").await?;
    let path = sqlx::query("SELECT file FROM pragma_database_list WHERE name = 'main'");
    let path: String = path.fetch_one(&mut *connection).await?.try_get(0)?;
    let is_new = is_empty_sqlite(connection).await?;
    if is_new {
        if read_only {
            return Err(StoreError::Foreign(ForeignFile::Empty));
        }
        switch_to_wal(connection).await?;
        let mut making = connection.begin_with("BEGIN IMMEDIATE").await?;
        // Another process may have been faster.
        if is_empty_sqlite(&mut making).await? {
            sqlx::raw_sql(AssertSqlSafe(sqlite_schema())).execute(&mut *making).await?;
        }
        making.commit().await?;
    }
    if number(connection, "PRAGMA application_id").await? != APPLICATION_ID {
        return Err(StoreError::Foreign(ForeignFile::Sqlite));
    }
    check_schema(connection).await?;
    settle(connection, DatabaseKind::Sqlite, read_only, StoreFaults::default()).await?;
    let file = LogFile::at(path.into());
    if is_new {
        file.keep_private().map_err(|error| StoreError::Database(sqlx::Error::from(error).into()))?;
    }
    Ok(file)
}

/// Whether the file has no tables yet.
async fn is_empty_sqlite(connection: &mut AnyConnection) -> Result<bool, StoreError> {
    let tables = number(connection, "SELECT count(*) FROM sqlite_master").await?;
    Ok(tables == 0 && number(connection, "PRAGMA application_id").await? == 0)
}

/// The mode stays with the file. While another connection is in the middle of something it cannot
/// be changed; waiting for a turn to write waits for that.
async fn switch_to_wal(connection: &mut AnyConnection) -> Result<(), StoreError> {
    for _ in 0..WAL_TRIES {
        match connection.execute("PRAGMA journal_mode = WAL").await.map_err(StoreError::from) {
            Err(StoreError::Busy) => connection.begin_with("BEGIN IMMEDIATE").await?.rollback().await?,
            switched => return switched.map(|_| ()),
        }
    }
    Err(StoreError::Busy)
}

fn sqlite_schema() -> String {
    let mut schema = words(TABLES, &[("{integer}", "INTEGER"), ("{bytes}", "BLOB"), ("{strict}", "STRICT")]);
    for table in APPEND_ONLY {
        schema += &words(SQLITE_TRIGGERS, &[("{table}", table)]);
    }
    schema + SQLITE_ORDER + &format!("PRAGMA application_id = {APPLICATION_ID};")
}

fn postgres_schema() -> String {
    let collated = "TEXT COLLATE \"C\""; // the order of bytes, as SQLite has it
    let mut schema = words(TABLES, &[("{integer}", "BIGINT"), ("{bytes}", "BYTEA"), ("{strict}", "")]);
    schema = words(&schema, &[("TEXT", collated)]) + POSTGRES_FUNCTIONS + POSTGRES_ORDER;
    for table in APPEND_ONLY {
        schema += &words(POSTGRES_TRIGGERS, &[("{table}", table)]);
    }
    schema
}

fn words(text: &str, words: &[(&str, &str)]) -> String {
    words.iter().fold(text.to_owned(), |text, (word, meaning)| text.replace(word, meaning))
}

async fn prepare_postgres(connection: &mut AnyConnection) -> Result<(), StoreError> {
    let mut making = connection.begin().await?;
    sqlx::query(MAKING_LOCK).execute(&mut *making).await?;
    let found = "SELECT count(*) FROM pg_catalog.pg_namespace WHERE nspname = 'relief'";
    if number(&mut making, found).await? == 0 {
        making.execute("CREATE SCHEMA relief").await?;
        making.execute("SET LOCAL search_path TO relief").await?;
        sqlx::raw_sql(AssertSqlSafe(postgres_schema())).execute(&mut *making).await?;
    }
    making.commit().await?;
    if number(
        connection,
        "SELECT count(*) FROM pg_catalog.pg_tables WHERE schemaname = 'relief' AND tablename = 'meta'",
    )
    .await?
        == 0
    {
        return Err(StoreError::Foreign(ForeignFile::Schema));
    }
    settle(connection, DatabaseKind::Postgres, false, StoreFaults::default()).await?;
    check_schema(connection).await
}

async fn check_schema(connection: &mut AnyConnection) -> Result<(), StoreError> {
    let row = sqlx::query("SELECT value FROM meta WHERE key = 'schema'").fetch_optional(connection).await?;
    let value: String = row.map(|row| row.try_get(0)).transpose()?.unwrap_or_default();
    match value.parse::<u64>() {
        Ok(SCHEMA) => Ok(()),
        Ok(found) if found > SCHEMA => Err(StoreError::Schema { found, known: SCHEMA }),
        _ => Err(Damage::NoSchema.into()),
    }
}

/// Settings of a single connection, applied to each.
///
/// SQLite: a commit is on the disk before it returns (`synchronous = FULL`, and `fullfsync` where a
/// system has a lesser sync); references are kept; a replaced line counts as a deleted one for
/// triggers; pages are looked at before they are believed.
pub(super) async fn settle(
    connection: &mut AnyConnection,
    kind: DatabaseKind,
    read_only: bool,
    faults: StoreFaults,
) -> Result<(), sqlx::Error> {
    match kind {
        DatabaseKind::Sqlite => {
            for pragma in [
                "PRAGMA busy_timeout = 30000",
                "PRAGMA synchronous = FULL",
                "PRAGMA fullfsync = ON",
                "PRAGMA checkpoint_fullfsync = ON",
                "PRAGMA foreign_keys = ON",
                "PRAGMA recursive_triggers = ON",
                "PRAGMA trusted_schema = OFF",
                "PRAGMA cell_size_check = ON",
            ] {
                connection.execute(pragma).await?;
            }
            if let Some(bytes) = faults.most_bytes {
                let page: i64 = connection.fetch_one("PRAGMA page_size").await?.try_get(0)?;
                let pages = bytes / page.unsigned_abs().max(1);
                connection.execute(AssertSqlSafe(format!("PRAGMA max_page_count = {pages}"))).await?;
            }
            let mode: String = connection.fetch_one("PRAGMA journal_mode").await?.try_get(0)?;
            if mode != "wal" && !read_only {
                // It was turned off, or the file system does not support it.
                connection.execute("PRAGMA journal_mode = WAL").await?;
            }
        }
        DatabaseKind::Postgres => {
            connection.execute("SET search_path TO relief").await?;
            // A server does not work for a client that is gone, or hold its lock.
            for setting in [
                "SET lock_timeout TO '30s'",
                "SET statement_timeout TO '60s'",
                "SET idle_in_transaction_session_timeout TO '60s'",
                "SET tcp_keepalives_idle TO 20",
                "SET tcp_keepalives_interval TO 5",
                "SET tcp_keepalives_count TO 3",
                "SET tcp_user_timeout TO '40s'",
            ] {
                connection.execute(setting).await?;
            }
            let durable = "SELECT set_config('synchronous_commit', 'on', false) \
                WHERE current_setting('synchronous_commit') = 'off'";
            connection.execute(durable).await?;
        }
    }
    Ok(())
}

/// The number that a statement answers with.
pub(super) async fn number(
    connection: &mut AnyConnection,
    statement: &'static str,
) -> Result<i64, StoreError> {
    let row = sqlx::query(statement).fetch_one(connection).await?;
    // A pragma answers with a small integer, a count with a large one.
    Ok(row.try_get::<i64, _>(0).or_else(|_| row.try_get::<i32, _>(0).map(i64::from))?)
}
