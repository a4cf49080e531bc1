//! A message that arrives in fragments, with limits of its memory and time.

use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use dicom_ul::pdu::{PDataValue, PDataValueType};

use super::message::{LARGEST_COMMAND, Request};

/// Time that is added to the time for an object's bytes at the lowest mean rate.
const PATIENCE: Duration = Duration::from_secs(60);
/// Lowest mean rate of an object, bytes per second.
const SLOWEST_BYTES_PER_S: usize = 16 << 10;

/// The memory for objects that are arriving, shared by all associations.
#[derive(Debug)]
pub(super) struct ObjectMemory {
    used: AtomicUsize,
    most: usize,
}

impl ObjectMemory {
    pub(super) fn new(most: usize) -> Self {
        Self { used: AtomicUsize::new(0), most }
    }

    /// Reserves bytes; false if the limit would be exceeded.
    fn take(&self, bytes: usize) -> bool {
        let used = self.used.fetch_add(bytes, Ordering::AcqRel) + bytes;
        if used > self.most {
            self.used.fetch_sub(bytes, Ordering::AcqRel);
        }
        used <= self.most
    }
}

/// A message of which some fragments have arrived.
pub(super) struct Message {
    memory: Arc<ObjectMemory>,
    /// Most bytes of its data set.
    largest: usize,
    command: Vec<u8>,
    request: Option<Request>,
    pub(super) data_set: Vec<u8>,
    since: Instant,
}

/// Why the receiver ends an association in the middle of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub(super) enum GivenUp {
    #[error("the message is damaged, or an unknown request")]
    NotUnderstood,
    #[error("an object is larger than allowed")]
    Large,
    #[error("the objects that are arriving have reached their limit of memory")]
    Memory,
    #[error("an object arrives slower than {SLOWEST_BYTES_PER_S} bytes per second")]
    Slow,
}

impl Message {
    pub(super) fn new(memory: Arc<ObjectMemory>, largest: usize) -> Self {
        let (command, data_set) = (Vec::new(), Vec::new());
        Self { memory, largest, command, request: None, data_set, since: Instant::now() }
    }

    /// Begins the next message.
    pub(super) fn clear(&mut self) {
        *self = Self::new(Arc::clone(&self.memory), self.largest);
    }

    /// Adds a fragment. Returns the presentation context with the request when the message is complete, or
    /// with an error when the association has to end.
    pub(super) fn push(&mut self, value: PDataValue) -> Option<(u8, Result<Request, GivenUp>)> {
        let context = value.presentation_context_id;
        let outcome = match value.value_type {
            PDataValueType::Command if self.request.is_none() => self.push_command(value),
            PDataValueType::Data if self.request.is_some() => self.push_data(&value),
            _ => Err(GivenUp::NotUnderstood),
        };
        outcome.transpose().map(|request| (context, request))
    }

    fn push_command(&mut self, value: PDataValue) -> Result<Option<Request>, GivenUp> {
        self.command.extend(value.data);
        if self.command.len() > LARGEST_COMMAND {
            return Err(GivenUp::NotUnderstood);
        }
        if !value.is_last {
            return Ok(None);
        }
        match Request::read(&self.command) {
            Some(request @ (Request::Echo { .. } | Request::Reported)) => Ok(Some(request)),
            Some(request) => {
                (self.request, self.since) = (Some(request), Instant::now());
                Ok(None)
            }
            None => Err(GivenUp::NotUnderstood),
        }
    }

    fn push_data(&mut self, value: &PDataValue) -> Result<Option<Request>, GivenUp> {
        let received = self.data_set.len() + value.data.len();
        if received > self.largest {
            return Err(GivenUp::Large);
        }
        if self.since.elapsed() > PATIENCE + Duration::from_secs((received / SLOWEST_BYTES_PER_S) as u64) {
            return Err(GivenUp::Slow);
        }
        if !self.memory.take(value.data.len()) {
            return Err(GivenUp::Memory);
        }
        self.data_set.extend_from_slice(&value.data);
        Ok(if value.is_last { self.request.take() } else { None })
    }
}

impl Drop for Message {
    fn drop(&mut self) {
        self.memory.used.fetch_sub(self.data_set.len(), Ordering::AcqRel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_share_their_memory_and_give_it_back() {
        let memory = Arc::new(ObjectMemory::new(1000));
        let data = |bytes: usize| PDataValue {
            presentation_context_id: 3,
            value_type: PDataValueType::Data,
            is_last: false,
            data: vec![0; bytes],
        };
        let store = || {
            let mut message = Message::new(Arc::clone(&memory), 800);
            let (sop_class, sop_instance) = ("1.2".to_owned(), "1.3".to_owned());
            message.request = Some(Request::Store { message: 1, sop_class, sop_instance });
            message
        };
        let (mut first, mut second) = (store(), store());
        assert!(first.push(data(700)).is_none() && second.push(data(300)).is_none());
        let given_up =
            |message: &mut Message, bytes| message.push(data(bytes)).and_then(|(_, request)| request.err());
        assert_eq!(given_up(&mut second, 1), Some(GivenUp::Memory));
        assert_eq!(given_up(&mut first, 101), Some(GivenUp::Large));
        first.clear();
        assert_eq!(given_up(&mut first, 1), Some(GivenUp::NotUnderstood), "a command comes first");
        assert!(second.push(data(400)).is_none());
        drop(second);
        assert_eq!(memory.used.load(Ordering::Acquire), 0);
    }
}
