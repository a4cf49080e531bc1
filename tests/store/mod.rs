//! The log of annotations from outside: edits, conflicts, damage, kills and PostgreSQL.
#![expect(clippy::unwrap_used, reason = "a test that cannot go on fails")]
#![allow(clippy::print_stderr, reason = "a test that cannot run says so aloud")]

mod basics;
mod damage;
mod killed;
mod made;
mod model;
#[cfg(feature = "full")]
mod postgres;
#[cfg(feature = "full")]
mod postgres_tls;
mod speed;
mod writers;

/// Tests of a log, by name: each of SQLite, and all of them together of PostgreSQL.
#[macro_export]
macro_rules! scenarios {
    ($($name:ident),* $(,)?) => {
        mod sqlite {
            $(
                #[tokio::test(flavor = "multi_thread", worker_threads = 2)]
                async fn $name() {
                    super::$name(&$crate::store::made::Made::new().await.store).await;
                }
            )*
        }

        /// Each on a database of its own.
        #[cfg(feature = "full")]
        pub(crate) async fn all(server: &$crate::store::postgres::Server) {
            $(
                let store = server.store(stringify!($name)).await;
                $name(&store).await;
                store.check().await.unwrap();
                store.close().await;
            )*
        }
    };
}
