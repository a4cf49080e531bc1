//! The conversation with callers: a thread for each association.

use std::net::{IpAddr, SocketAddr, TcpListener, TcpStream};
use std::panic::AssertUnwindSafe;
use std::str::FromStr;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::thread::JoinHandle;
use std::time::Duration;

use dicom_ul::association::Association;
use dicom_ul::association::server::{AccessControl, ServerAssociation, ServerAssociationOptions};
use dicom_ul::pdu::{AssociationRJServiceUserReason, PDataValue, PDataValueType, Pdu, UserIdentity};
use relief_dicom::{CommitmentResult, READ_SOP_CLASSES, READ_TRANSFER_SYNTAXES, read_commitment_request};

use super::commitment::{COMMITMENT, report, report_to};
use super::inbox::{Inbox, Transfer, TransferEnd};
use super::incoming::{Message, ObjectMemory};
use super::message::{Request, Status};
use super::strangers::{Stranger, Strangers};

const VERIFICATION: &str = "1.2.840.10008.1.1";
/// The longest silence of a caller.
const PATIENCE: Duration = Duration::from_secs(60);
/// Largest unit of the protocol, bytes.
const LARGEST_PDU: u32 = 128 << 10;

/// A caller by its application entity title, and its address if that is known.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AllowedCaller {
    title: String,
    address: Option<IpAddr>,
    /// The address of its own provider.
    port: Option<u16>,
}

/// Why a text is not a caller.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "expected a title of 1 to 16 characters, TITLE@ADDRESS, or TITLE@ADDRESS:PORT, such as PACS@10.0.0.7:104"
)]
pub struct CallerError;

impl FromStr for AllowedCaller {
    type Err = CallerError;

    fn from_str(text: &str) -> Result<Self, CallerError> {
        let (title, address, port) = match text.split_once('@') {
            None => (text, None, None),
            Some((title, address)) => match address.parse::<SocketAddr>() {
                Ok(address) => (title, Some(address.ip()), Some(address.port())),
                Err(_) => (title, Some(address.parse().map_err(|_| CallerError)?), None),
            },
        };
        match is_title(title) && port != Some(0) {
            true => Ok(Self { title: title.to_owned(), address, port }),
            false => Err(CallerError),
        }
    }
}

impl AllowedCaller {
    /// The address of reports for it, if its provider is known.
    fn provider(&self) -> Option<SocketAddr> {
        Some(SocketAddr::new(self.address?, self.port?))
    }

    fn is(&self, title: &str, address: IpAddr) -> bool {
        self.title == title && self.address.is_none_or(|known| known == address)
    }
}

/// Whether a text can be an application entity title (PS3.5, AE).
pub(super) fn is_title(text: &str) -> bool {
    let is_letter = |letter: u8| (b' '..=b'~').contains(&letter) && letter != b'\\';
    (1..=16).contains(&text.len()) && text.bytes().all(is_letter) && text.trim() == text
}

/// The identity of a receiver, and the callers that it accepts.
#[derive(Clone, Debug)]
pub struct ReceiverOptions {
    /// Its application entity title: callers must call it so.
    pub title: String,
    /// The callers that are known; all where empty.
    pub callers: Vec<AllowedCaller>,
    /// Associations at a time; more are aborted.
    pub associations: usize,
    /// Largest object, bytes.
    pub object_bytes: usize,
    /// Most bytes of objects that are arriving, in all associations together.
    pub memory_bytes: usize,
}

impl ReceiverOptions {
    /// Options with the usual limits: 16 associations, objects of 256 MiB, 512 MiB for all objects that are
    /// arriving.
    ///
    /// # Errors
    /// When the title cannot be one.
    pub fn new(title: &str) -> Result<Self, CallerError> {
        match is_title(title) {
            true => Ok(Self {
                title: title.to_owned(),
                callers: Vec::new(),
                associations: 16,
                object_bytes: 256 << 20,
                memory_bytes: 512 << 20,
            }),
            false => Err(CallerError),
        }
    }
}

/// A storage provider that listens until it is dropped.
#[derive(Debug)]
pub struct Receiver {
    address: SocketAddr,
    is_stopping: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Receiver {
    /// Listens, and puts what known callers send into an inbox.
    ///
    /// # Errors
    /// When the address cannot be listened on.
    pub fn start(address: SocketAddr, options: ReceiverOptions, inbox: Arc<Inbox>) -> std::io::Result<Self> {
        let listener = TcpListener::bind(address)?;
        let address = listener.local_addr()?;
        let is_stopping = Arc::new(AtomicBool::new(false));
        let memory = Arc::new(ObjectMemory::new(options.memory_bytes));
        let shared = Shared { options, inbox, memory, strangers: Arc::default(), open: AtomicUsize::new(0) };
        let (stop, shared) = (Arc::clone(&is_stopping), Arc::new(shared));
        let thread = std::thread::Builder::new()
            .name("relief-receive".to_owned())
            .spawn(move || accept(&listener, &shared, &stop))?;
        Ok(Self { address, is_stopping, thread: Some(thread) })
    }

    /// Its address.
    #[must_use]
    pub fn address(&self) -> SocketAddr {
        self.address
    }
}

/// No new association is taken; objects that are being written become whole or absent.
impl Drop for Receiver {
    fn drop(&mut self) {
        self.is_stopping.store(true, Ordering::Release);
        // Wakes the thread, which waits for a caller.
        let _ = TcpStream::connect(self.address);
        if let Some(thread) = self.thread.take() {
            let _ = thread.join();
        }
    }
}

#[derive(Debug)]
struct Shared {
    options: ReceiverOptions,
    inbox: Arc<Inbox>,
    memory: Arc<ObjectMemory>,
    strangers: Arc<Strangers>,
    /// Associations of known callers.
    open: AtomicUsize,
}

fn accept(listener: &TcpListener, shared: &Arc<Shared>, is_stopping: &AtomicBool) {
    for stream in listener.incoming() {
        if is_stopping.load(Ordering::Acquire) {
            return;
        }
        let stranger = |stream: TcpStream| Some((shared.strangers.add(&stream).ok()?, stream));
        let Some((stranger, stream)) = stream.ok().and_then(stranger) else {
            std::thread::sleep(Duration::from_millis(50)); // no descriptors are left
            continue;
        };
        let shared = Arc::clone(shared);
        let conversation = move || {
            // A panic of the protocol library ends one association.
            let ended = std::panic::catch_unwind(AssertUnwindSafe(|| shared.serve(stream, stranger)));
            if ended.is_err() {
                tracing::error!("an association ended by a panic");
            }
        };
        let started = std::thread::Builder::new().name("relief-association".to_owned()).spawn(conversation);
        if let Err(error) = started {
            tracing::error!("an association cannot be served: {error}");
        }
    }
}

/// Counts an association until it ends.
struct OpenGuard<'a>(&'a AtomicUsize);

impl Drop for OpenGuard<'_> {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::AcqRel);
    }
}

/// Known callers, who call the receiver by its title.
struct KnownCallers<'a> {
    callers: &'a [AllowedCaller],
    address: IpAddr,
}

impl AccessControl for KnownCallers<'_> {
    fn check_access(
        &self,
        this: &str,
        calling: &str,
        called: &str,
        _: Option<&UserIdentity>,
    ) -> Result<(), AssociationRJServiceUserReason> {
        let is_known = |caller: &AllowedCaller| caller.is(calling.trim(), self.address);
        if called.trim() != this {
            return Err(AssociationRJServiceUserReason::CalledAETitleNotRecognized);
        }
        if !self.callers.is_empty() && !self.callers.iter().any(is_known) {
            return Err(AssociationRJServiceUserReason::CallingAETitleNotRecognized);
        }
        Ok(())
    }
}

impl Shared {
    fn serve(&self, stream: TcpStream, stranger: Stranger) {
        let Ok(peer) = stream.peer_addr() else { return };
        let _ = stream.set_nodelay(true);
        let callers = KnownCallers { callers: &self.options.callers, address: peer.ip().to_canonical() };
        let mut negotiation = ServerAssociationOptions::new()
            .ae_access_control(callers)
            .ae_title(self.options.title.as_str())
            .max_pdu_length(LARGEST_PDU)
            .strict(true)
            .read_timeout(PATIENCE)
            .write_timeout(PATIENCE)
            .with_abstract_syntax(VERIFICATION)
            .with_abstract_syntax(COMMITMENT);
        for class in READ_SOP_CLASSES {
            negotiation = negotiation.with_abstract_syntax(*class);
        }
        for syntax in READ_TRANSFER_SYNTAXES {
            negotiation = negotiation.with_transfer_syntax(*syntax);
        }
        let established = negotiation.establish(stream);
        drop(stranger);
        match established {
            Ok(association) => self.converse(association, peer.ip().to_canonical()),
            Err(error) => tracing::warn!("a caller at {} is refused: {error}", peer.ip()),
        }
    }

    fn converse(&self, association: ServerAssociation<TcpStream>, address: IpAddr) {
        let is_one_too_many = self.open.fetch_add(1, Ordering::AcqRel) >= self.options.associations;
        let _open = OpenGuard(&self.open);
        if is_one_too_many {
            tracing::warn!("a caller is turned away: {} associations are open", self.options.associations);
            let _ = association.abort();
            return;
        }
        let mut transfer = self.inbox.transfer();
        transfer.end = self.requests(association, address, &mut transfer);
    }

    /// Answers requests until the association ends.
    fn requests(
        &self,
        mut association: ServerAssociation<TcpStream>,
        address: IpAddr,
        transfer: &mut Transfer<'_>,
    ) -> TransferEnd {
        let mut message = Message::new(Arc::clone(&self.memory), self.options.object_bytes);
        loop {
            let values = match association.receive() {
                Ok(Pdu::PData { data }) => data,
                Ok(Pdu::ReleaseRQ) => {
                    let _ = association.send(&Pdu::ReleaseRP);
                    return TransferEnd::Released;
                }
                Ok(_) | Err(_) => return TransferEnd::Interrupted,
            };
            for value in values {
                let Some((context, request)) = message.push(value) else { continue };
                let answer = match request {
                    Ok(Request::Reported) => {
                        message.clear();
                        continue;
                    }
                    Ok(request) => self.answer(&association, context, &request, &message.data_set, transfer),
                    Err(reason) => {
                        tracing::warn!("an association is ended: {reason}");
                        None
                    }
                };
                message.clear();
                let Some(Answer { data, commitment }) = answer else {
                    let _ = association.abort();
                    return TransferEnd::Interrupted;
                };
                let value = PDataValue {
                    presentation_context_id: context,
                    value_type: PDataValueType::Command,
                    is_last: true,
                    data,
                };
                if association.send(&Pdu::PData { data: vec![value] }).is_err() {
                    return TransferEnd::Interrupted;
                }
                if let Some(result) = commitment {
                    self.report(&mut association, context, address, &result);
                }
            }
        }
    }

    /// Says which objects are kept: to the caller's provider where that is known, or in this
    /// association.
    fn report(
        &self,
        association: &mut ServerAssociation<TcpStream>,
        context: u8,
        address: IpAddr,
        result: &CommitmentResult,
    ) {
        let title = association.peer_ae_title().trim().to_owned();
        let caller = self.options.callers.iter().find(|caller| caller.is(&title, address));
        let reported = match caller.and_then(AllowedCaller::provider) {
            Some(provider) => report_to(provider, [&self.options.title, &title], result),
            None => report(association, context, 1, result),
        };
        if let Err(error) = reported {
            tracing::warn!("a report about storage commitment did not arrive: {error}");
        }
    }

    /// The answer to a request; `None` where it has no place in this association.
    fn answer(
        &self,
        association: &ServerAssociation<TcpStream>,
        context: u8,
        request: &Request,
        data_set: &[u8],
        transfer: &mut Transfer<'_>,
    ) -> Option<Answer> {
        let negotiated = association.presentation_contexts().iter().find(|one| one.id == context)?;
        let mut commitment = None;
        let status = match request {
            Request::Reported => return None,
            Request::Echo { .. } => Status::Success,
            Request::Commit { sop_class, .. } => {
                if negotiated.abstract_syntax != COMMITMENT || sop_class != COMMITMENT {
                    return None;
                }
                match read_commitment_request(&negotiated.transfer_syntax, data_set) {
                    Err(error) => {
                        tracing::warn!("a request for storage commitment is refused: {error}");
                        Status::InvalidArgument
                    }
                    Ok(request) => match self.inbox.commit(request) {
                        Ok(result) => {
                            commitment = Some(result);
                            Status::Success
                        }
                        Err(error) => {
                            tracing::error!("the folder of received objects cannot be read: {error}");
                            Status::OutOfResources
                        }
                    },
                }
            }
            Request::Store { sop_class, sop_instance, .. } => {
                if *sop_class != negotiated.abstract_syntax {
                    return None;
                }
                let object = [sop_class, sop_instance, negotiated.transfer_syntax.as_str()];
                self.inbox.store(transfer, object, data_set)
            }
        };
        Some(Answer { data: request.response(status), commitment })
    }
}

/// A response, and the report that follows it.
struct Answer {
    data: Vec<u8>,
    commitment: Option<CommitmentResult>,
}
