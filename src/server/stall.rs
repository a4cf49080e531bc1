//! A stream whose writes fail when the other side takes too little for too long.

use std::future::Future;
use std::io;
use std::pin::Pin;
use std::task::{Context, Poll};
use std::time::Duration;

use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::time::{Instant, Sleep};

/// Bytes that buy back one second of waiting: who takes less than this on average is cut off, even
/// if a byte arrives now and then.
const LEAST_BYTES_PER_S: f64 = 4096.0;

/// See the module.
pub(super) struct StallGuard<S> {
    stream: S,
    /// Longest wait that is not bought back.
    patience: Duration,
    /// Waits so far, less what was bought back.
    waited: Duration,
    /// Runs while a write waits, since this moment.
    alarm: Option<(Instant, Pin<Box<Sleep>>)>,
}

impl<S> StallGuard<S> {
    pub(super) fn new(stream: S, patience: Duration) -> Self {
        Self { stream, patience, waited: Duration::ZERO, alarm: None }
    }

    /// Passes progress on and turns waits that are too long into an error. `bytes` of a result buy
    /// time back.
    fn watch<T>(
        &mut self,
        progress: Poll<io::Result<T>>,
        bytes: impl Fn(&T) -> usize,
        context: &mut Context<'_>,
    ) -> Poll<io::Result<T>> {
        if let Poll::Ready(done) = &progress {
            if let Some((since, _)) = self.alarm.take() {
                self.waited += since.elapsed();
            }
            #[allow(clippy::cast_precision_loss, reason = "bytes of one write")]
            let bought = done.as_ref().map_or(0, bytes) as f64 / LEAST_BYTES_PER_S;
            self.waited = self.waited.saturating_sub(Duration::from_secs_f64(bought));
            return progress;
        }
        let left = self.patience.saturating_sub(self.waited);
        let (_, alarm) = self.alarm.get_or_insert_with(|| {
            let now = Instant::now();
            (now, Box::pin(tokio::time::sleep_until(now + left)))
        });
        match alarm.as_mut().poll(context) {
            Poll::Ready(()) => Poll::Ready(Err(io::ErrorKind::TimedOut.into())),
            Poll::Pending => Poll::Pending,
        }
    }
}

impl<S: AsyncRead + Unpin> AsyncRead for StallGuard<S> {
    fn poll_read(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        buffer: &mut ReadBuf<'_>,
    ) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(cx, buffer)
    }
}

impl<S: AsyncWrite + Unpin> AsyncWrite for StallGuard<S> {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let progress = Pin::new(&mut self.stream).poll_write(cx, bytes);
        self.watch(progress, |written| *written, cx)
    }

    fn poll_write_vectored(
        mut self: Pin<&mut Self>,
        cx: &mut Context<'_>,
        parts: &[io::IoSlice<'_>],
    ) -> Poll<io::Result<usize>> {
        let progress = Pin::new(&mut self.stream).poll_write_vectored(cx, parts);
        self.watch(progress, |written| *written, cx)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let progress = Pin::new(&mut self.stream).poll_flush(cx);
        self.watch(progress, |()| 0, cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        let progress = Pin::new(&mut self.stream).poll_shutdown(cx);
        self.watch(progress, |()| 0, cx)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tokio::io::{AsyncReadExt, AsyncWriteExt};

    /// Whether a reader that takes `bytes` every second for a minute gets so far.
    async fn survives(bytes: usize) -> bool {
        let (near, mut far) = tokio::io::duplex(64);
        let mut guard = StallGuard::new(near, Duration::from_secs(20));
        let reader = tokio::spawn(async move {
            let mut buffer = vec![0; bytes];
            for _ in 0..60 {
                tokio::time::sleep(Duration::from_secs(1)).await;
                if far.read_exact(&mut buffer).await.is_err() {
                    return false;
                }
            }
            true
        });
        let _ = guard.write_all(&vec![0; 60 * bytes]).await;
        drop(guard);
        reader.await.unwrap()
    }

    #[tokio::test(start_paused = true)]
    async fn a_reader_of_a_few_bytes_a_second_is_cut_off_and_a_slow_one_is_not() {
        assert!(!survives(1 << 10).await);
        assert!(survives(8 << 10).await);
    }
}
