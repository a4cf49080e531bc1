//! Files in batches that fit into memory together.
//!
//! Zip entries and deflated data sets are unpacked whole, one at a time by each thread. Batches are
//! processed one after the other, each in parallel, so the unpacked bytes are bounded whatever the
//! number of threads. (A thread must not wait for a turn: while it decodes the frames of one file,
//! the scheduler may give it the next file to open, and it would wait for itself.)

/// Most bytes that are unpacked at a time. A single file that has more is a batch of its own.
const MOST_UNPACKED: u64 = 1 << 30;

/// Divides `files`, in their order, into batches whose bytes in memory are at most
/// [`MOST_UNPACKED`] together.
pub(super) fn of<T>(files: Vec<T>, memory_bytes: impl Fn(&T) -> u64) -> Vec<Vec<T>> {
    let mut batches: Vec<Vec<T>> = Vec::new();
    let mut taken = 0u64;
    for file in files {
        let needed = memory_bytes(&file);
        taken = taken.saturating_add(needed);
        match batches.last_mut() {
            Some(batch) if taken <= MOST_UNPACKED => batch.push(file),
            _ => {
                batches.push(vec![file]);
                taken = needed;
            }
        }
    }
    batches
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn batches_keep_order_and_fit() {
        let half = MOST_UNPACKED / 2;
        let files = vec![0, half, half, 1, MOST_UNPACKED, MOST_UNPACKED + 9, 0, 0];
        let batches = of(files, |&bytes| bytes);
        let expected =
            [vec![0, half, half], vec![1], vec![MOST_UNPACKED], vec![MOST_UNPACKED + 9], vec![0, 0]];
        assert_eq!(batches, expected);
        assert_eq!(of(vec![0u64; 9], |&bytes| bytes).len(), 1);
        assert!(of(Vec::new(), |bytes: &u64| *bytes).is_empty());
    }
}
