//! Command sets of DIMSE messages (PS3.7 annex E): implicit VR, little endian, group 0000.

/// Largest command set, bytes.
pub(super) const LARGEST_COMMAND: usize = 64 << 10;
const ECHO_REQUEST: u16 = 0x0030;
const STORE_REQUEST: u16 = 0x0001;
const ACTION_REQUEST: u16 = 0x0130;
const EVENT_REPORT_REQUEST: u16 = 0x0100;
/// The Action Type ID of a request for storage commitment.
const COMMIT: u16 = 1;
/// The bit of Command Field that marks a response.
const RESPONSE: u16 = 0x8000;
/// The Command Data Set Type of a message without a data set.
const NO_DATA_SET: u16 = 0x0101;

/// A status of a response (PS3.7 annex C, PS3.4 table B.2-1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Status {
    /// The object is durable, or was before.
    Success,
    /// Another object of this UID was stored before.
    Duplicate,
    /// There is no room.
    OutOfResources,
    /// The data set is of another object than the command.
    Mismatch,
    /// The data set is damaged.
    CannotUnderstand,
    /// An argument of an action is invalid.
    InvalidArgument,
}

impl Status {
    fn code(self) -> u16 {
        match self {
            Self::Success => 0x0000,
            Self::Duplicate => 0x0111,
            Self::OutOfResources => 0xA700,
            Self::Mismatch => 0xA900,
            Self::CannotUnderstand => 0xC000,
            Self::InvalidArgument => 0x0115,
        }
    }
}

/// A request that is understood.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Request {
    /// C-ECHO.
    Echo { message: u16, sop_class: String },
    /// C-STORE; its data set follows.
    Store { message: u16, sop_class: String, sop_instance: String },
    /// N-ACTION for storage commitment; its data set follows.
    Commit { message: u16, sop_class: String, sop_instance: String },
    /// The response to a report, which needs none.
    Reported,
}

impl Request {
    /// Reads a command set; `None` where it is damaged or another request.
    pub(super) fn read(mut command: &[u8]) -> Option<Self> {
        let (mut field, mut message, mut data_set) = (None, None, None);
        let (mut sop_class, mut sop_instance, mut action) = (None, None, None);
        while !command.is_empty() {
            let (element, value, rest) = split(command)?;
            command = rest;
            let number = || Some(u16::from_le_bytes(value.try_into().ok()?));
            match element {
                // Affected and Requested SOP Class and Instance UID.
                0x0002 | 0x0003 => sop_class = Some(uid(value)?),
                0x0100 => field = Some(number()?),
                0x0110 => message = Some(number()?),
                0x0800 => data_set = Some(number()?),
                0x1000 | 0x1001 => sop_instance = Some(uid(value)?),
                0x1008 => action = Some(number()?),
                _ => {}
            }
        }
        if field? == EVENT_REPORT_REQUEST | RESPONSE {
            return (data_set? == NO_DATA_SET).then_some(Self::Reported);
        }
        let (message, sop_class) = (message?, sop_class?);
        match (field?, data_set? == NO_DATA_SET) {
            (ECHO_REQUEST, true) => Some(Self::Echo { message, sop_class }),
            (STORE_REQUEST, false) => Some(Self::Store { message, sop_class, sop_instance: sop_instance? }),
            (ACTION_REQUEST, false) if action? == COMMIT => {
                Some(Self::Commit { message, sop_class, sop_instance: sop_instance? })
            }
            _ => None,
        }
    }

    /// The command set of a request for storage, or an echo, of medium priority.
    pub(super) fn command(&self) -> Vec<u8> {
        let (field, message, sop_class, sop_instance) = self.parts();
        let mut elements = element(0x0002, &padded(sop_class));
        elements.extend(element(0x0100, &field.to_le_bytes()));
        elements.extend(element(0x0110, &message.to_le_bytes()));
        let data_set = if sop_instance.is_some() { 0 } else { NO_DATA_SET };
        if sop_instance.is_some() {
            elements.extend(element(0x0700, &0_u16.to_le_bytes()));
        }
        elements.extend(element(0x0800, &data_set.to_le_bytes()));
        elements.extend(sop_instance.map(|uid| element(0x1000, &padded(uid))).unwrap_or_default());
        with_length(elements)
    }

    fn parts(&self) -> (u16, u16, &str, Option<&str>) {
        match self {
            Self::Echo { message, sop_class } => (ECHO_REQUEST, *message, sop_class, None),
            Self::Store { message, sop_class, sop_instance } => {
                (STORE_REQUEST, *message, sop_class, Some(sop_instance))
            }
            Self::Commit { message, sop_class, sop_instance } => {
                (ACTION_REQUEST, *message, sop_class, Some(sop_instance))
            }
            Self::Reported => (EVENT_REPORT_REQUEST, 0, "", None),
        }
    }

    /// The command set of the response.
    pub(super) fn response(&self, status: Status) -> Vec<u8> {
        let (field, message, sop_class, sop_instance) = self.parts();
        let mut elements = element(0x0002, &padded(sop_class));
        elements.extend(element(0x0100, &(field | RESPONSE).to_le_bytes()));
        elements.extend(element(0x0120, &message.to_le_bytes()));
        elements.extend(element(0x0800, &NO_DATA_SET.to_le_bytes()));
        elements.extend(element(0x0900, &status.code().to_le_bytes()));
        elements.extend(sop_instance.map(|uid| element(0x1000, &padded(uid))).unwrap_or_default());
        if matches!(self, Self::Commit { .. }) {
            elements.extend(element(0x1008, &COMMIT.to_le_bytes()));
        }
        with_length(elements)
    }
}

/// The command set of a report about storage commitment (N-EVENT-REPORT), of which the data set
/// follows.
pub(super) fn commitment_report(
    message: u16,
    sop_class: &str,
    sop_instance: &str,
    is_complete: bool,
) -> Vec<u8> {
    let event: u16 = if is_complete { 1 } else { 2 };
    let mut elements = element(0x0002, &padded(sop_class));
    elements.extend(element(0x0100, &EVENT_REPORT_REQUEST.to_le_bytes()));
    elements.extend(element(0x0110, &message.to_le_bytes()));
    elements.extend(element(0x0800, &0_u16.to_le_bytes()));
    elements.extend(element(0x1000, &padded(sop_instance)));
    elements.extend(element(0x1002, &event.to_le_bytes()));
    with_length(elements)
}

/// The status of a response; `None` if the bytes are not a response to C-STORE.
pub(super) fn response_status(command: &[u8]) -> Option<u16> {
    status_of(command, STORE_REQUEST)
}

/// The status of a response to a report; `None` if the bytes are something else.
pub(super) fn report_status(command: &[u8]) -> Option<u16> {
    status_of(command, EVENT_REPORT_REQUEST)
}

fn status_of(mut command: &[u8], request: u16) -> Option<u16> {
    let (mut field, mut status) = (None, None);
    while !command.is_empty() {
        let (number, value, rest) = split(command)?;
        command = rest;
        match number {
            0x0100 => field = Some(u16::from_le_bytes(value.try_into().ok()?)),
            0x0900 => status = Some(u16::from_le_bytes(value.try_into().ok()?)),
            _ => {}
        }
    }
    status.filter(|_| field == Some(request | RESPONSE))
}

/// The number and the value of the first element of group 0000, and the bytes behind it.
fn split(command: &[u8]) -> Option<(u16, &[u8], &[u8])> {
    let (head, rest) = command.split_first_chunk::<8>()?;
    let [g0, g1, e0, e1, length @ ..] = *head;
    let length = usize::try_from(u32::from_le_bytes(length)).ok()?;
    let value = rest.get(..length)?;
    ([g0, g1] == [0, 0]).then(|| (u16::from_le_bytes([e0, e1]), value, &rest[length..]))
}

/// Elements behind their common length.
fn with_length(elements: Vec<u8>) -> Vec<u8> {
    let length = u32::try_from(elements.len()).unwrap_or_default();
    [element(0x0000, &length.to_le_bytes()), elements].concat()
}

fn element(number: u16, value: &[u8]) -> Vec<u8> {
    let length = u32::try_from(value.len()).unwrap_or_default();
    [&[0, 0], &number.to_le_bytes()[..], &length.to_le_bytes(), value].concat()
}

/// A UID of even length.
fn padded(uid: &str) -> Vec<u8> {
    let mut bytes = uid.as_bytes().to_vec();
    bytes.resize(bytes.len().next_multiple_of(2), 0);
    bytes
}

fn uid(value: &[u8]) -> Option<String> {
    let text = std::str::from_utf8(value).ok()?.trim_end_matches(['\0', ' ']);
    let is_uid = (1..=64).contains(&text.len())
        && text.bytes().all(|letter| letter.is_ascii_digit() || letter == b'.');
    is_uid.then(|| text.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn store() -> Vec<u8> {
        let parts = [
            element(0x0002, b"1.2.3\0"),
            element(0x0100, &STORE_REQUEST.to_le_bytes()),
            element(0x0110, &7_u16.to_le_bytes()),
            element(0x0700, &0_u16.to_le_bytes()),
            element(0x0800, &0_u16.to_le_bytes()),
            element(0x1000, b"4.5.6\0"),
        ];
        parts.concat()
    }

    #[test]
    fn a_request_is_read_and_its_response_names_it() {
        let request = Request::read(&store()).unwrap();
        let [sop_class, sop_instance] = ["1.2.3", "4.5.6"].map(str::to_owned);
        assert_eq!(request, Request::Store { message: 7, sop_class, sop_instance });
        let response = request.response(Status::OutOfResources);
        assert_eq!(response[8..12], u32::to_le_bytes(response.len() as u32 - 12));
        for part in [&b"4.5.6\0"[..], &[0x01, 0x80], &[0x00, 0xA7]] {
            assert!(response.windows(part.len()).any(|window| window == part), "{part:?}");
        }
    }

    #[test]
    fn other_commands_are_not_understood() {
        assert_eq!(Request::read(&[]), None);
        assert_eq!(Request::read(&store()[..store().len() - 1]), None);
        let with = |at: usize, value: u8| {
            let mut bytes = store();
            bytes[at] = value;
            Request::read(&bytes)
        };
        assert_eq!((with(8, b'/'), with(0, 8), with(22, 0x21)), (None, None, None));
    }

    #[test]
    fn a_command_is_read_as_it_was_written_and_a_response_has_its_status() {
        let [sop_class, sop_instance] = ["1.2.3", "4.5.67"].map(str::to_owned);
        let echo = Request::Echo { message: 2, sop_class: sop_class.clone() };
        let store = Request::Store { message: 7, sop_class, sop_instance };
        assert_eq!(Request::read(&echo.command()), Some(echo));
        assert_eq!(response_status(&store.response(Status::Duplicate)), Some(0x0111));
        assert_eq!(response_status(&store.command()), None);
        assert_eq!(Request::read(&store.command()), Some(store));
    }

    #[test]
    fn an_action_and_a_report_are_about_commitment() {
        let [sop_class, sop_instance] = ["1.2.3", "4.5.67"].map(str::to_owned);
        let action = |kind: u16| {
            let parts = [
                element(0x0003, b"1.2.3\0"),
                element(0x0100, &ACTION_REQUEST.to_le_bytes()),
                element(0x0110, &9_u16.to_le_bytes()),
                element(0x0800, &0_u16.to_le_bytes()),
                element(0x1001, b"4.5.67"),
                element(0x1008, &kind.to_le_bytes()),
            ];
            Request::read(&parts.concat())
        };
        assert_eq!(action(1), Some(Request::Commit { message: 9, sop_class, sop_instance }));
        assert_eq!(action(2), None);
        let report = commitment_report(3, "1.2.3", "4.5.67", false);
        assert_eq!(report[8..12], u32::to_le_bytes(report.len() as u32 - 12));
        assert_eq!((Request::read(&report), report_status(&report)), (None, None));
    }

    proptest! {
        #[test]
        fn no_bytes_cause_a_panic(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let _ = Request::read(&bytes);
        }
    }
}
