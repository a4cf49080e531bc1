//! Reports about storage commitment (N-EVENT-REPORT, PS3.4 annex J): in the association of the request,
//! or in a new one to the caller's own provider.

use std::net::{SocketAddr, TcpStream};
use std::time::Duration;

use dicom_ul::association::SyncAssociation;
use dicom_ul::association::client::{ClientAssociation, ClientAssociationOptions};
use dicom_ul::pdu::{PDataValue, PDataValueType, Pdu};
use relief_dicom::{COMMITMENT_TRANSFER_SYNTAXES, CommitmentResult, write_commitment_result};

use super::message::{LARGEST_COMMAND, commitment_report, report_status};

/// Storage Commitment Push Model, and its only instance.
pub(super) const COMMITMENT: &str = "1.2.840.10008.1.20.1";
const INSTANCE: &str = "1.2.840.10008.1.20.1.1";
/// The longest times of a connection by the caller's provider, and of an answer.
const CONNECT: Duration = Duration::from_secs(10);
const PATIENCE: Duration = Duration::from_secs(60);

/// Sends a report in an association. The response is not awaited.
///
/// # Errors
/// When the association broke, or its transfer syntax is one of images.
pub(super) fn report<A: SyncAssociation<TcpStream>>(
    association: &mut A,
    context: u8,
    message: u16,
    result: &CommitmentResult,
) -> Result<(), ReportError> {
    let negotiated = association.presentation_contexts().iter().find(|one| one.id == context);
    let syntax = negotiated.map(|one| one.transfer_syntax.clone()).unwrap_or_default();
    let data_set = write_commitment_result(&syntax, result).ok_or(ReportError::TransferSyntax)?;
    let command = PDataValue {
        presentation_context_id: context,
        value_type: PDataValueType::Command,
        is_last: true,
        data: commitment_report(message, COMMITMENT, INSTANCE, result.missing.is_empty()),
    };
    SyncAssociation::send(association, &Pdu::PData { data: vec![command] })?;
    let mut data = association.send_pdata(context);
    std::io::Write::write_all(&mut data, &data_set)?;
    data.finish()?;
    Ok(())
}

/// Sends a report to the provider of a caller in a new association, and waits for the response.
///
/// # Errors
/// When the provider does not answer, or does not take the report.
pub(super) fn report_to(
    provider: SocketAddr,
    [calling, called]: [&str; 2],
    result: &CommitmentResult,
) -> Result<(), ReportError> {
    let mut association: ClientAssociation<TcpStream> = ClientAssociationOptions::new()
        .calling_ae_title(calling)
        .called_ae_title(called)
        .connection_timeout(CONNECT)
        .read_timeout(PATIENCE)
        .write_timeout(PATIENCE)
        .with_presentation_context(COMMITMENT, COMMITMENT_TRANSFER_SYNTAXES.to_vec())
        // The peer that opens this association provides the service.
        .with_role_selection(COMMITMENT, false, true)
        .establish(provider)?;
    let context = association.presentation_contexts().first().map(|context| context.id);
    report(&mut association, context.ok_or(ReportError::TransferSyntax)?, 1, result)?;
    let mut answer = Vec::new();
    loop {
        let Pdu::PData { data } = association.receive()? else { return Err(ReportError::Answer) };
        for value in data {
            answer.extend(value.data);
            if value.value_type != PDataValueType::Command || answer.len() > LARGEST_COMMAND {
                return Err(ReportError::Answer);
            }
            if value.is_last {
                let _ = association.release(); // the report has arrived
                return match report_status(&answer) {
                    Some(0) => Ok(()),
                    _ => Err(ReportError::Answer),
                };
            }
        }
    }
}

/// Why a report did not arrive. The next request of the caller is answered all the same.
#[derive(Debug, thiserror::Error)]
pub(super) enum ReportError {
    /// The association was not opened, or broke.
    #[error(transparent)]
    Association(#[from] dicom_ul::association::Error),
    /// The data set was not written.
    #[error(transparent)]
    Write(#[from] std::io::Error),
    /// No transfer syntax of data sets was agreed on.
    #[error("no transfer syntax for reports was agreed on")]
    TransferSyntax,
    /// The other side refuses the report.
    #[error("the report was refused")]
    Answer,
}
