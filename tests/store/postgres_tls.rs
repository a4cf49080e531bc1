//! The way to PostgreSQL is encrypted where the address asks for it, and the database is the one that
//! it claims to be.

use std::path::PathBuf;

use relief_store::{Store, StoreError};
use sqlx::Row;

use super::made::{create, edit, names, point};
use crate::postgres_server::Server;

/// Invariant: A log that asks for encryption is never written over a plain connection, or to a
/// database whose certificate is not the named authority's.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn the_way_to_a_database_is_encrypted_as_its_address_says() {
    let Some(server) = Server::start("TLS of PostgreSQL").await else { return };
    server.database("tls").await;
    let asking = |mode: &str| format!("{}?sslmode={mode}", server.url("tls"));
    // A server without TLS.
    let refused = Store::open(&asking("require")).await.unwrap_err();
    assert!(matches!(refused, StoreError::Unencrypted(_)), "{refused}");

    let folder = tempfile::tempdir().unwrap();
    let authority = Authority::new();
    let file = |name: &str, text: &str| -> PathBuf {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path
    };
    let (certificate, key) = authority.certify("localhost");
    server.encrypt(&certificate, &key).await;

    let store = Store::open(&asking("require")).await.unwrap();
    store.apply(&edit("anna", vec![create(&point("a", 0.0))])).await.unwrap();
    let encrypted = "SELECT bool_and(ssl), count(*) FROM pg_stat_ssl JOIN pg_stat_activity USING (pid) \
        WHERE datname = 'tls' AND pid <> pg_backend_pid()";
    let row = sqlx::Executor::fetch_one(&mut server.admin("tls").await, encrypted).await.unwrap();
    assert!(row.get::<bool, _>(0) && row.get::<i64, _>(1) > 0, "the log's connections are plain");
    store.close().await;

    let trusted = file("authority.pem", &authority.pem());
    let other = file("other.pem", &Authority::new().pem());
    let verified = |host: &str, root: &PathBuf| {
        let url = server.url("tls").replace("127.0.0.1", host);
        format!("{url}?sslmode=verify-full&sslrootcert={}", root.display())
    };
    let store = Store::open(&verified("localhost", &trusted)).await.unwrap();
    assert_eq!(names(&store).await, ["a"]);
    store.close().await;
    // Another authority, and a name that the certificate does not have.
    for url in [verified("localhost", &other), verified("127.0.0.1", &trusted)] {
        let refused = Store::open(&url).await.unwrap_err();
        assert!(refused.to_string().contains("invalid peer certificate"), "{refused}");
    }
}

/// Signs certificates.
struct Authority {
    issuer: rcgen::CertifiedIssuer<'static, rcgen::KeyPair>,
}

impl Authority {
    fn new() -> Self {
        let mut parameters = rcgen::CertificateParams::new(Vec::new()).unwrap();
        parameters.is_ca = rcgen::IsCa::Ca(rcgen::BasicConstraints::Unconstrained);
        let key = rcgen::KeyPair::generate().unwrap();
        Self { issuer: rcgen::CertifiedIssuer::self_signed(parameters, key).unwrap() }
    }

    fn pem(&self) -> String {
        self.issuer.pem()
    }

    /// A certificate for a host, and its key, as PEM.
    fn certify(&self, host: &str) -> (String, String) {
        let key = rcgen::KeyPair::generate().unwrap();
        let parameters = rcgen::CertificateParams::new(vec![host.to_owned()]).unwrap();
        (parameters.signed_by(&key, &self.issuer).unwrap().pem(), key.serialize_pem())
    }
}
