//! Bulk data from child to parent: two windows of a file in memory, written and read in turns.
//!
//! A socket passes some 200 KiB at a time and wakes the other side for each; a window passes 8 MiB.
//! The socket says which window is full, and which is free again. Neither side takes memory by an
//! announced size: the system gives pages of a vector as windows arrive.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result, Write};
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::FileExt;

use rayon::prelude::*;

/// Bytes of a window.
const WINDOW: usize = 8 << 20;
/// Bytes of the file: two windows, so that one is written while the other one is read.
pub(crate) const FILE_BYTES: u64 = 2 * WINDOW as u64;

/// Bytes that a thread copies at a time.
const CHUNK: usize = 1 << 20;

/// The windows of one child.
#[derive(Debug)]
pub(crate) struct Windows(File);

impl Windows {
    /// The parent's end, and the child's, which it gets as its standard error.
    pub(crate) fn new() -> Result<(Self, OwnedFd)> {
        let file = rustix::fs::memfd_create("relief-windows", rustix::fs::MemfdFlags::CLOEXEC)?;
        let childs = file.try_clone()?;
        Ok((Self(file.into()), childs))
    }

    /// The child's end. Standard error is `/dev/null` afterwards: a decoder that prints a warning
    /// would write it into the first window.
    pub(crate) fn take_stderr() -> Result<Self> {
        let file = std::io::stderr().as_fd().try_clone_to_owned()?;
        let nowhere = File::options().write(true).open("/dev/null")?;
        rustix::stdio::dup2_stderr(&nowhere)?;
        Ok(Self(file.into()))
    }

    /// Sends values as the machine has them: both sides are the same program.
    pub(crate) fn send<T: bytemuck::NoUninit>(
        &self,
        socket: &mut (impl Read + Write),
        values: &[T],
    ) -> Result<()> {
        let windows = bytemuck::cast_slice::<T, u8>(values).chunks(WINDOW);
        let count = windows.len();
        for (number, bytes) in windows.enumerate() {
            if number >= 2 {
                one(socket)?;
            }
            self.0.write_all_at(bytes, offset(number))?;
            socket.write_all(&[1])?;
        }
        // The next values begin with both windows free.
        (0..count.min(2)).try_for_each(|_| one(socket))
    }

    /// Receives values. `count` is within the limits of the caller: the whole range of addresses is
    /// reserved, and its pages are taken as windows arrive. Several threads take them, because the
    /// system's clearing of pages takes longer than the copy.
    ///
    /// `seen` gets the values of each window, while the next one is copied.
    ///
    /// # Errors
    /// When the child ends before, or there is no such range of addresses.
    pub(crate) fn receive<T: bytemuck::Pod + Send + Sync>(
        &self,
        socket: &mut (impl Read + Write),
        count: usize,
        mut seen: impl FnMut(&[T]) + Send,
    ) -> Result<Vec<T>> {
        let values = bytemuck::allocation::try_zeroed_vec::<T>(count);
        let mut values = values.map_err(|()| Error::from(ErrorKind::OutOfMemory))?;
        let mut last: &[T] = &[];
        for (number, window) in values.chunks_mut(WINDOW / size_of::<T>()).enumerate() {
            one(socket)?;
            let copy = || self.copy(number, bytemuck::cast_slice_mut(window));
            rayon::join(copy, || seen(last)).0?;
            socket.write_all(&[1])?;
            last = window;
        }
        seen(last);
        Ok(values)
    }

    /// Copies the bytes of a window.
    fn copy(&self, number: usize, window: &mut [u8]) -> Result<()> {
        let chunks = window.par_chunks_mut(CHUNK).enumerate();
        chunks.try_for_each(|(at, bytes)| self.0.read_exact_at(bytes, offset(number) + (at * CHUNK) as u64))
    }
}

fn offset(number: usize) -> u64 {
    if number.is_multiple_of(2) { 0 } else { WINDOW as u64 }
}

/// Waits for the other side's byte.
fn one(socket: &mut impl Read) -> Result<()> {
    socket.read_exact(&mut [0])
}

#[cfg(test)]
mod tests {
    use std::os::unix::net::UnixStream;

    use super::*;

    /// Both ends and their sockets.
    fn ends() -> ((Windows, UnixStream), (Windows, UnixStream)) {
        let ((parents, childs), (here, there)) = (Windows::new().unwrap(), UnixStream::pair().unwrap());
        ((parents, here), (Windows(childs.into()), there))
    }

    #[test]
    fn values_of_any_number_of_windows_come_through_one_after_the_other() {
        let ((parents, mut here), (childs, mut there)) = ends();
        let counts = [0, 1, WINDOW / 2 - 1, WINDOW / 2, WINDOW / 2 + 1, 2 * WINDOW + 77];
        let values = |count: usize| (0..count).map(|at| (at * 7 + count) as i16).collect::<Vec<_>>();
        let child = std::thread::Builder::new().name("child".to_owned());
        let sending = move || counts.map(|count| childs.send(&mut there, &values(count)).unwrap());
        let child = child.spawn(sending).unwrap();
        for count in counts {
            let mut seen = Vec::new();
            let received = parents.receive(&mut here, count, |part: &[i16]| seen.extend_from_slice(part));
            assert!(received.unwrap() == values(count) && seen == values(count), "{count}");
        }
        child.join().unwrap();
    }

    #[test]
    fn an_announced_size_allocates_nothing_and_a_file_cut_short_is_an_error() {
        let ((parents, mut here), (childs, mut there)) = ends();
        assert!(parents.receive::<i16>(&mut here, usize::MAX, |_| ()).is_err());
        childs.0.set_len(10).unwrap();
        there.write_all(&[1]).unwrap();
        assert!(parents.receive::<i16>(&mut here, 100, |_| ()).is_err(), "the window holds less");
        drop(there);
        assert!(parents.receive::<i16>(&mut here, 1, |_| ()).is_err(), "the child ended");
    }
}
