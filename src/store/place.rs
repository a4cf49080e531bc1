//! The place of a log: a file of SQLite, or a database of a PostgreSQL server.

use std::net::IpAddr;
use std::str::FromStr;

use sqlx::ConnectOptions;
use sqlx::any::AnyConnectOptions;

use super::error::{LocationError, StoreError};

/// The program that keeps the log.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DatabaseKind {
    Sqlite,
    Postgres,
}

/// A place that can be connected to. Not shown: it may have a password.
pub(super) struct DatabaseAddress {
    pub(super) kind: DatabaseKind,
    /// Nothing may be written.
    pub(super) read_only: bool,
    pub(super) options: AnyConnectOptions,
}

impl DatabaseAddress {
    /// Reads a file's path or a URL. A SQLite file that is not there is made on connecting if
    /// `create` says so.
    pub(super) fn parse(place: &str, create: bool) -> Result<Self, StoreError> {
        sqlx::any::install_default_drivers();
        if place.starts_with("postgres://") || place.starts_with("postgresql://") {
            if !cfg!(feature = "postgres") {
                return Err(LocationError::NoPostgres.into());
            }
            let mut address = Self::connect_to(DatabaseKind::Postgres, place, false)?;
            encrypt(&mut address.options);
            return Ok(address);
        }
        if let Some(rest) = place.strip_prefix("sqlite:") {
            let rest = rest.strip_prefix("//").unwrap_or(rest);
            let (path, asked) = rest.split_once('?').unwrap_or((rest, ""));
            let mode = match asked {
                "" | "mode=rwc" => writing(create),
                "mode=rw" => "mode=rw",
                "mode=ro" => "mode=ro",
                "immutable=1" => "mode=ro&immutable=1",
                _ => return Err(LocationError::Mode.into()),
            };
            if path.is_empty() || path == ":memory:" {
                return Err(LocationError::NoFile.into());
            }
            return Self::connect_to(
                DatabaseKind::Sqlite,
                &format!("sqlite://{path}?{mode}"),
                mode.starts_with("mode=ro"),
            );
        }
        if place.contains("://") {
            return Err(LocationError::Scheme.into());
        }
        if place.is_empty() {
            return Err(LocationError::Empty.into());
        }
        let path = std::path::absolute(place).map_err(LocationError::Path)?;
        let Some(path) = path.to_str() else { return Err(LocationError::NotUtf8.into()) };
        Self::connect_to(
            DatabaseKind::Sqlite,
            &format!("sqlite://{}?{}", encoded(path), writing(create)),
            false,
        )
    }

    fn connect_to(kind: DatabaseKind, url: &str, read_only: bool) -> Result<Self, StoreError> {
        let options = AnyConnectOptions::from_str(url);
        let options = options.map_err(LocationError::Url)?;
        // Statements contain no values and reveal only how the log works; they are not logged.
        Ok(Self { kind, read_only, options: options.disable_statement_logging() })
    }
}

/// Requires encryption on the way to another machine, unless the address states its own rule.
fn encrypt(options: &mut AnyConnectOptions) {
    let url = &mut options.database_url;
    let says = |name: &str| url.query_pairs().any(|(key, _)| key == name);
    let host = url.host_str().unwrap_or_default();
    let bare = host.trim_start_matches('[').trim_end_matches(']');
    let is_local = host.is_empty()
        || host == "localhost"
        || host.starts_with("%2F") // the folder of a Unix socket
        || bare.parse::<IpAddr>().is_ok_and(|address| address.is_loopback());
    if !is_local && !says("sslmode") && !says("ssl-mode") && !says("host") {
        url.query_pairs_mut().append_pair("sslmode", "require");
    }
}

const fn writing(create: bool) -> &'static str {
    if create { "mode=rwc" } else { "mode=rw" }
}

/// A path as a URL has it: every byte that could mean something else as `%` and two digits.
fn encoded(path: &str) -> String {
    let plain = |byte: u8| byte.is_ascii_alphanumeric() || b"/._-~".contains(&byte);
    let letter = |byte: u8| if plain(byte) { char::from(byte).to_string() } else { format!("%{byte:02X}") };
    path.bytes().map(letter).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_files_and_urls() {
        let url = |place: &str, create| {
            let place = DatabaseAddress::parse(place, create).unwrap();
            (place.kind, place.read_only, place.options.database_url.to_string())
        };
        let (kind, read_only, file) = url("/a b/ü?#%.db", true);
        assert_eq!((kind, read_only), (DatabaseKind::Sqlite, false));
        assert_eq!(file, "sqlite:///a%20b/%C3%BC%3F%23%25.db?mode=rwc");
        assert!(url("a.db", false).2.ends_with("/a.db?mode=rw"));
        assert_eq!(
            url("sqlite:/a.db?mode=ro", true),
            (DatabaseKind::Sqlite, true, "sqlite:///a.db?mode=ro".to_owned())
        );
        assert_eq!(url("sqlite:///a.db", true).2, "sqlite:///a.db?mode=rwc");
        assert!(url("sqlite:/a.db?immutable=1", true).1);
        for wrong in
            ["", "mysql://x/y", "sqlite::memory:", "sqlite:", "sqlite:/a?mode=memory", "postgres://[x"]
        {
            assert!(matches!(DatabaseAddress::parse(wrong, true), Err(StoreError::Place(_))), "{wrong}");
        }
    }

    #[cfg(feature = "postgres")]
    #[test]
    fn databases_elsewhere_are_reached_encrypted() {
        assert_eq!(
            DatabaseAddress::parse("postgres://me@localhost/x", true).unwrap().kind,
            DatabaseKind::Postgres
        );
        for (place, query) in [
            ("postgres://me@localhost/x", None),
            ("postgres://me@[::1]:5432/x", None),
            ("postgres:///x?host=/run/postgresql", Some("host=/run/postgresql")),
            ("postgres://me@db.example/x", Some("sslmode=require")),
            ("postgres://me@db.example/x?sslmode=disable", Some("sslmode=disable")),
            ("postgres://me@192.0.2.1/x?sslmode=verify-full", Some("sslmode=verify-full")),
        ] {
            let found = DatabaseAddress::parse(place, true).unwrap().options.database_url;
            assert_eq!(found.query(), query, "{place}");
        }
    }

    #[cfg(not(feature = "postgres"))]
    #[test]
    fn a_build_without_postgres_names_the_feature() {
        let Err(error) = DatabaseAddress::parse("postgres://me@localhost/x", true) else {
            panic!("no driver")
        };
        assert!(error.to_string().contains("--features postgres"), "{error}");
    }
}
