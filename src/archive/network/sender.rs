//! A user of storage (C-STORE): an association for each object.

use std::fmt;
use std::io::Write;
use std::net::TcpStream;
use std::str::FromStr;
use std::time::Duration;

use dicom_ul::association::client::{ClientAssociation, ClientAssociationOptions};
use dicom_ul::pdu::{PDataValue, PDataValueType, Pdu};
use relief_dicom::ObjectParts;

use super::message::{Request, response_status};
use super::receiver::is_title;

/// The longest times of a connection by the other side, and of an answer.
const CONNECT: Duration = Duration::from_secs(10);
const PATIENCE: Duration = Duration::from_secs(60);
const SCHEME: &str = "dicom://";

/// A storage provider of the DICOM network, `dicom://TITLE@HOST:PORT`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NetworkAddress {
    title: String,
    /// Host and port.
    host: String,
}

/// Why a text is not the address of a storage provider.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected dicom://TITLE@HOST:PORT, with a title of 1 to 16 characters")]
pub struct NetworkAddressError;

impl FromStr for NetworkAddress {
    type Err = NetworkAddressError;

    fn from_str(text: &str) -> Result<Self, NetworkAddressError> {
        let rest = text.strip_prefix(SCHEME).and_then(|rest| rest.rsplit_once('@'));
        let (title, host) = rest.ok_or(NetworkAddressError)?;
        let has_port =
            host.rsplit_once(':').is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok());
        match is_title(title) && has_port {
            true => Ok(Self { title: title.to_owned(), host: host.to_owned() }),
            false => Err(NetworkAddressError),
        }
    }
}

impl fmt::Display for NetworkAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{SCHEME}{}@{}", self.title, self.host)
    }
}

/// Why an object was not sent.
#[derive(Debug, thiserror::Error)]
pub enum SendError {
    /// The host has no address, or does not answer.
    #[error("{provider} does not answer; is its address right, and does it run?")]
    Unreachable {
        /// The address.
        provider: String,
        /// The reason.
        #[source]
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The provider rejects the association, or the conversation broke.
    #[error("{provider} ends the association; does it know the caller {calling:?}?")]
    Association {
        /// The address.
        provider: String,
        /// The title of this program.
        calling: String,
        /// The reason.
        #[source]
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// The provider does not take objects of this kind or transfer syntax.
    #[error("{provider} does not take objects of this kind in this transfer syntax")]
    Kind {
        /// The address.
        provider: String,
    },
    /// The answer is no response to the request.
    #[error("{provider} sends something else where a response is expected")]
    Answer {
        /// The address.
        provider: String,
    },
}

/// The status of a response (PS3.4 table B.2-1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StoreStatus(pub u16);

impl StoreStatus {
    /// Whether the object is stored now; some providers warn of changes that they made.
    #[must_use]
    pub fn is_stored(self) -> bool {
        matches!(self.0, 0x0000 | 0xB000 | 0xB006 | 0xB007)
    }

    /// Whether the provider had the object.
    #[must_use]
    pub fn was_there(self) -> bool {
        self.0 == 0x0111
    }
}

impl NetworkAddress {
    /// Stores an object, as the caller `calling`.
    ///
    /// # Errors
    /// When the provider does not answer, rejects the association, or does not take the object's
    /// kind.
    pub fn store(&self, calling: &str, object: &ObjectParts<'_>) -> Result<StoreStatus, SendError> {
        let provider = || self.to_string();
        let broken = |source: dicom_ul::association::Error| SendError::Association {
            provider: provider(),
            calling: calling.to_owned(),
            source: source.into(),
        };
        let mut association = ClientAssociationOptions::new()
            .calling_ae_title(calling)
            .called_ae_title(self.title.as_str())
            .connection_timeout(CONNECT)
            .read_timeout(PATIENCE)
            .write_timeout(PATIENCE)
            .with_presentation_context(
                object.identity.sop_class.as_str(),
                vec![object.transfer_syntax.as_str()],
            )
            .establish(self.host.as_str())
            .map_err(|error| match error {
                dicom_ul::association::Error::Connect { source, .. }
                | dicom_ul::association::Error::ToAddress { source, .. } => {
                    SendError::Unreachable { provider: provider(), source: source.into() }
                }
                dicom_ul::association::Error::NoAcceptedPresentationContexts { .. } => {
                    SendError::Kind { provider: provider() }
                }
                error => broken(error),
            })?;
        let context = association.presentation_contexts().first().map(|context| context.id);
        let context = context.ok_or_else(|| SendError::Kind { provider: provider() })?;
        let status = converse(&mut association, context, object).map_err(|error| match error {
            ConversationError::Broken(error) => broken(error),
            ConversationError::Write(error) => SendError::Association {
                provider: provider(),
                calling: calling.to_owned(),
                source: error.into(),
            },
            ConversationError::Answer => SendError::Answer { provider: provider() },
        })?;
        let _ = association.release(); // the object is stored, or is not
        Ok(status)
    }
}

enum ConversationError {
    Broken(dicom_ul::association::Error),
    Write(std::io::Error),
    Answer,
}

/// Sends the request and the data set; the status of the response.
fn converse(
    association: &mut ClientAssociation<TcpStream>,
    context: u8,
    object: &ObjectParts<'_>,
) -> Result<StoreStatus, ConversationError> {
    let request = Request::Store {
        message: 1,
        sop_class: object.identity.sop_class.clone(),
        sop_instance: object.identity.sop_instance.clone(),
    };
    let command = PDataValue {
        presentation_context_id: context,
        value_type: PDataValueType::Command,
        is_last: true,
        data: request.command(),
    };
    association.send(&Pdu::PData { data: vec![command] }).map_err(ConversationError::Broken)?;
    let mut data = association.send_pdata(context);
    data.write_all(object.data_set).map_err(ConversationError::Write)?;
    data.finish().map_err(ConversationError::Write)?;
    let mut answer = Vec::new();
    loop {
        let Pdu::PData { data } = association.receive().map_err(ConversationError::Broken)? else {
            return Err(ConversationError::Answer);
        };
        for value in data {
            answer.extend(value.data);
            if value.value_type != PDataValueType::Command || answer.len() > super::message::LARGEST_COMMAND {
                return Err(ConversationError::Answer);
            }
            if value.is_last {
                return response_status(&answer).map(StoreStatus).ok_or(ConversationError::Answer);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn addresses_have_a_title_a_host_and_a_port() {
        for text in ["dicom://PACS@10.0.0.7:104", "dicom://A B@ct-server:11112", "dicom://PACS@[::1]:104"] {
            let address: NetworkAddress = text.parse().unwrap();
            assert_eq!(address.to_string(), text);
        }
        for text in
            ["PACS@host:104", "dicom://host:104", "dicom://PACS@host", "dicom://@host:1", "dicom://A@:104"]
        {
            assert_eq!(text.parse::<NetworkAddress>(), Err(NetworkAddressError), "{text}");
        }
    }
}
