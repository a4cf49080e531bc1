//! Rows of a picture, dealt to threads.
//!
//! A thread takes the next rows when it has cast its last ones, so threads wait for each other only
//! at the end of a picture. The caller casts as well, and asks between its rows whether to continue.

use std::time::{Duration, Instant};

use parking_lot::Mutex;

use super::super::error::RenderError;
use super::super::watch::Watch;

/// Casts pieces in their order with all threads, and asks `watch` each time `pace` has passed.
/// Returns the number of pieces that are cast: the first ones, all if `watch` does not cancel.
pub(super) fn deal<T: Send>(
    pieces: Vec<T>,
    cast: impl Fn(T) + Sync,
    pace: Duration,
    watch: &mut Watch<'_>,
) -> (usize, Result<(), RenderError>) {
    let count = pieces.len();
    let helpers = rayon::current_num_threads().min(count).saturating_sub(1);
    let queue = Mutex::new(pieces.into_iter());
    let take = || queue.lock().next();
    rayon::in_place_scope(|scope| {
        for _ in 0..helpers {
            scope.spawn(|_| std::iter::from_fn(take).for_each(&cast));
        }
        let mut asked = Instant::now();
        for piece in std::iter::from_fn(take) {
            cast(piece);
            if asked.elapsed() < pace {
                continue;
            }
            let left = queue.lock().len();
            if let Err(cancelled) = watch.band_done(left > 0) {
                let left = std::mem::take(&mut *queue.lock()).len();
                return (count - left, Err(cancelled));
            }
            asked = Instant::now();
        }
        (count, Ok(()))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::ops::ControlFlow;

    /// Each piece is cast once, and a cancelled picture has the first ones.
    #[test]
    fn pieces_are_cast_once_and_in_order() {
        for last in [1, 3, u64::MAX] {
            let cast = Mutex::new(Vec::new());
            let mut goes_on = |progress: crate::Progress| {
                if progress.bands < last { ControlFlow::Continue(()) } else { ControlFlow::Break(()) }
            };
            let (done, outcome) = deal(
                (0..100).collect(),
                |piece: usize| cast.lock().push(piece),
                Duration::ZERO,
                &mut Watch::new(&mut goes_on),
            );
            let mut cast = cast.into_inner();
            cast.sort_unstable();
            assert_eq!(cast, (0..done).collect::<Vec<_>>());
            assert!(outcome.is_err() || done == 100, "{done}");
            assert!(outcome.is_ok() == (last == u64::MAX) || done == 100, "cancelled after {done}");
        }
    }

    #[test]
    fn without_pieces_nothing_is_asked() {
        let mut goes_on = |_| ControlFlow::Break(());
        let nothing: Vec<()> = Vec::new();
        let (done, outcome) =
            deal(nothing, |()| unreachable!(), Duration::ZERO, &mut Watch::new(&mut goes_on));
        assert!(done == 0 && outcome.is_ok());
    }
}
