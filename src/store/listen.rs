//! A connection that listens to a channel of PostgreSQL. What its words mean is up to `watch`.

use std::time::Duration;

use sqlx::any::AnyConnectOptions;
use sqlx::pool::PoolOptions;
use sqlx::postgres::{PgConnectOptions, PgListener};
use sqlx::{ConnectOptions, Executor, Postgres};
use tokio::time::timeout;

use super::error::{ConnectionFault, StoreError};

/// Interval of the probes of a listening connection, and their time limit.
const SIGN_OF_LIFE: Duration = Duration::from_secs(10);
const REPLY: Duration = Duration::from_secs(5);

/// Listens from its opening on.
pub(super) struct Listener(PgListener);

impl Listener {
    pub(super) async fn open(options: &AnyConnectOptions, channel: &str) -> Result<Self, StoreError> {
        let options = PgConnectOptions::from_url(&options.database_url)?.disable_statement_logging();
        let pool = PoolOptions::<Postgres>::new().max_connections(1).max_lifetime(None).idle_timeout(None);
        let mut listener = PgListener::connect_with(&pool.connect_with(options).await?).await?;
        listener.ignore_pool_close_event(true);
        // A connection that was lost is an error here: the next call makes another one, and the log
        // is read.
        listener.eager_reconnect(false);
        listener.listen(channel).await?;
        Ok(Self(listener))
    }

    /// Waits for notifications; returns the words of all that came together.
    pub(super) async fn words(&mut self) -> Result<Vec<String>, StoreError> {
        let Self(listener) = self;
        loop {
            match timeout(SIGN_OF_LIFE, listener.try_recv()).await {
                Ok(Ok(Some(first))) => {
                    let rest = std::iter::from_fn(|| listener.next_buffered());
                    return Ok(std::iter::once(first)
                        .chain(rest)
                        .map(|one| one.payload().to_owned())
                        .collect());
                }
                Ok(Ok(None)) => return Err(ConnectionFault::ListenerLost.into()),
                Ok(Err(error)) => return Err(error.into()),
                Err(_) => {
                    let reply = timeout(REPLY, (&mut *listener).execute("SELECT 1")).await;
                    reply.map_err(|_| ConnectionFault::ListenerSilent)??;
                }
            }
        }
    }
}
