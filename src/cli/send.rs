//! `relief send`: stores reports, segmentations and pictures in a DICOM archive.

use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::str::FromStr;

use anyhow::{Context, bail};
use relief_archive::{
    AddressError, Archive, ArchiveAddress, NetworkAddress, NetworkAddressError, OutgoingObject, StoreOutcome,
};
use serde::Serialize;

use crate::bucket::CopiesArguments;
use crate::output::{print_json, say};
use crate::series;
use crate::source::{self, SeriesOptions};
use relief_base::read_at_most;
use relief_batch::Location;
use relief_dicom::{
    CaptureOptions, CapturedPicture, ObjectError, ObjectIdentity, SeriesReference, Strictness, parts_of,
    read_identity, write_capture,
};

/// Store DICOM objects and pictures in an archive
///
/// Files of DICOM, such as the reports and segmentations of `relief annotate export`, are stored as
/// they are. Pictures (PNG, JPEG) become Secondary Captures of the study of --series. An object that
/// the archive already has is not stored again; the same picture always makes the same object.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  relief annotate --db ann.db export --format sr --out report.dcm --series chest
  relief send report.dcm --to dicomweb+https://ct-server/dicom-web --archive-login-file login
  relief send front.png side.png --series chest --to dicomweb+https://ct-server/dicom-web
  relief send turn/*.png --multi-frame --series chest --to dicomweb+https://ct-server/dicom-web
  relief send report.dcm --to dicom://PACS@ct-server:104 --aet RELIEF        by the DICOM network
  relief send front.png --series chest --out capture.dcm        look at the object before it is stored

Exit status: 0 all objects are in the archive, 1 some are not.")]
pub(super) struct SendArguments {
    /// DICOM files, and pictures (.png, .jpg)
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// The archive: dicomweb+https://HOST/ROOT, or dicom://TITLE@HOST:PORT by the DICOM network
    #[arg(long, value_name = "ARCHIVE", required_unless_present = "out")]
    to: Option<Destination>,
    /// Application entity title of this program, by which an archive of the DICOM network knows it
    #[arg(long, value_name = "TITLE", default_value = "RELIEF")]
    aet: String,
    /// The series that pictures show: a folder, a file, a DICOMDIR or a zip; or its address in an
    /// archive
    #[arg(long, value_name = "PATH")]
    series: Option<PathBuf>,
    /// The series, where PATH holds several (`relief inspect PATH` lists them)
    #[arg(long, value_name = "UID", requires = "series")]
    series_uid: Option<String>,
    /// Put all pictures into one object, as its frames: a turntable
    #[arg(long, requires = "series")]
    multi_frame: bool,
    /// Frames per second at which viewers play it
    #[arg(long, value_name = "RATE", default_value_t = 12.0, value_parser = parse_rate, requires = "multi_frame")]
    fps: f64,
    /// Description of the series of pictures
    #[arg(long, value_name = "TEXT", default_value = CaptureOptions::DESCRIPTION, requires = "series")]
    description: String,
    /// Leave the patient out of objects made of pictures, and replace UIDs
    #[arg(long, requires = "series")]
    deidentify: bool,
    /// Write the one object made of pictures to this file, too
    #[arg(long, value_name = "FILE.dcm", requires = "series")]
    out: Option<PathBuf>,
    #[command(flatten)]
    copies: CopiesArguments,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

/// The destination of objects.
#[derive(Clone, Debug)]
enum Destination {
    /// By DICOMweb.
    Web(ArchiveAddress),
    /// By the DICOM network.
    Network(NetworkAddress),
}

impl FromStr for Destination {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text.starts_with("dicom://") {
            return text.parse().map(Self::Network).map_err(|error: NetworkAddressError| error.to_string());
        }
        text.parse()
            .map(Self::Web)
            .map_err(|error: AddressError| format!("{error}; or dicom://TITLE@HOST:PORT"))
    }
}

/// A way to store objects.
enum Store<'a> {
    Web(Archive),
    Network { address: &'a NetworkAddress, calling: &'a str },
}

/// Largest file that is sent, bytes.
const LARGEST_FILE: u64 = 1 << 30;

/// The outcome for an object, and the files that it was made from.
#[derive(Serialize)]
struct SentObject {
    files: Vec<PathBuf>,
    outcome: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    reason: Option<u16>,
}

/// An object, and the files that it was made from.
struct Prepared {
    files: Vec<PathBuf>,
    bytes: Vec<u8>,
}

pub(super) fn run(arguments: &SendArguments) -> anyhow::Result<ExitCode> {
    let prepared = prepare(arguments)?;
    if let Some(out) = &arguments.out {
        let [object] = &*prepared else { bail!("--out is for one object, and there are {}", prepared.len()) };
        crate::output::write_whole(out, &object.bytes)?;
    }
    let Some(to) = &arguments.to else { return Ok(ExitCode::SUCCESS) };
    let store = Store::open(to, arguments)?;
    let mut sent = Vec::new();
    for object in prepared {
        sent.push(store.send(object)?);
    }
    let refused = sent.iter().filter(|one| one.outcome == REFUSED).count();
    if arguments.json {
        print_json(&sent)?;
    } else {
        sent.iter().for_each(print);
    }
    if refused > 0 {
        eprintln!("relief: the archive did not store {refused} of {} objects", sent.len());
        return Ok(ExitCode::FAILURE);
    }
    Ok(ExitCode::SUCCESS)
}

const REFUSED: &str = "refused";

impl<'a> Store<'a> {
    fn open(to: &'a Destination, arguments: &'a SendArguments) -> anyhow::Result<Self> {
        match to {
            Destination::Network(address) => Ok(Self::Network { address, calling: &arguments.aet }),
            Destination::Web(address) if address.study().is_some() || !address.query().is_empty() => {
                bail!(
                    "--to must be the root of an archive, without a study and a query: objects say where they belong"
                )
            }
            Destination::Web(address) => {
                Ok(Self::Web(Archive::open(address, &arguments.copies.archive.access()?)?))
            }
        }
    }

    fn send(&self, object: Prepared) -> anyhow::Result<SentObject> {
        let about = || format!("cannot send {}", object.files[0].display());
        let outcome = match self {
            Self::Web(archive) => {
                let outgoing = outgoing(object.bytes).with_context(about)?;
                archive.store(&outgoing).with_context(about)?
            }
            Self::Network { address, calling } => {
                let parts = parts_of(&object.bytes).with_context(about)?;
                let status = address.store(calling, &parts).with_context(about)?;
                match status {
                    status if status.is_stored() => StoreOutcome::Stored,
                    status if status.was_there() => StoreOutcome::AlreadyThere,
                    status => StoreOutcome::Refused { reason: Some(status.0) },
                }
            }
        };
        let (outcome, reason) = match outcome {
            StoreOutcome::Stored => ("stored", None),
            StoreOutcome::AlreadyThere => ("already there", None),
            StoreOutcome::Refused { reason } => (REFUSED, reason),
        };
        Ok(SentObject { files: object.files, outcome, reason })
    }
}

/// An object with the UIDs that it has.
pub(crate) fn outgoing(object: Vec<u8>) -> Result<OutgoingObject, ObjectError> {
    let ObjectIdentity { study, series, sop_instance, .. } = read_identity(&object)?;
    Ok(OutgoingObject { study, series, instance: sop_instance, file: object.into() })
}

fn print(sent: &SentObject) {
    let first = sent.files[0].display();
    let more =
        if sent.files.len() > 1 { format!(" and {} more", sent.files.len() - 1) } else { String::new() };
    let reason = sent.reason.map_or_else(String::new, |reason| format!(" (failure reason {reason:#06x})"));
    say!("{first}{more}: {}{reason}", sent.outcome);
}

/// All objects, before the first one is sent.
fn prepare(arguments: &SendArguments) -> anyhow::Result<Vec<Prepared>> {
    let (pictures, objects): (Vec<&PathBuf>, Vec<&PathBuf>) =
        arguments.files.iter().partition(|file| is_picture(file));
    let mut prepared = Vec::new();
    for file in objects {
        prepared.push(Prepared { files: vec![file.clone()], bytes: read(file)? });
    }
    if pictures.is_empty() {
        if arguments.series.is_some() {
            bail!("--series is for pictures, and there is none");
        }
        return Ok(prepared);
    }
    let Some(path) = &arguments.series else {
        bail!("{} is a picture; say which series it shows with --series PATH", pictures[0].display());
    };
    let series = reference(path, arguments)?;
    let decoded = pictures.iter().map(|path| decode(path)).collect::<anyhow::Result<Vec<_>>>()?;
    let groups: Vec<(Vec<PathBuf>, Vec<CapturedPicture>)> = match arguments.multi_frame {
        true => vec![(pictures.into_iter().cloned().collect(), decoded)],
        false => pictures
            .into_iter()
            .map(|path| vec![path.clone()])
            .zip(decoded.into_iter().map(|it| vec![it]))
            .collect(),
    };
    for ((files, pictures), number) in groups.into_iter().zip(1..) {
        let options = CaptureOptions {
            description: arguments.description.clone(),
            number,
            frame_ms: 1_000.0 / arguments.fps,
        };
        prepared.push(Prepared { bytes: write_capture(&pictures, &series, &options)?, files });
    }
    Ok(prepared)
}

fn reference(path: &Path, arguments: &SendArguments) -> anyhow::Result<SeriesReference> {
    const NO_UIDS: &str = "the series lacks UIDs by which objects refer to it";
    let uid = arguments.series_uid.clone();
    let reference = if Location::is_remote(path) {
        let options = SeriesOptions { series_uid: uid, phase: None, strict: false, downsample: 1 };
        let (loaded, ()) = series::load_after(path, &arguments.copies, &options, |_| Ok(()))?;
        std::sync::Arc::unwrap_or_clone(loaded.reference.context(NO_UIDS)?)
    } else {
        let found = source::discover(path, Strictness::Lenient)?;
        let entry = source::select(&found, uid.as_deref())?;
        SeriesReference::of(entry).context(NO_UIDS)?
    };
    Ok(if arguments.deidentify { reference.deidentified() } else { reference })
}

fn is_picture(path: &Path) -> bool {
    let ending = path.extension().map(std::ffi::OsStr::to_ascii_lowercase);
    ending.is_some_and(|ending| ["png", "jpg", "jpeg"].iter().any(|known| ending == *known))
}

fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    let read = read_at_most(path, LARGEST_FILE).with_context(|| format!("cannot read {}", path.display()))?;
    read.with_context(|| format!("{} is larger than 1 GiB", path.display()))
}

fn decode(path: &Path) -> anyhow::Result<CapturedPicture> {
    let about = || format!("cannot read {}", path.display());
    let mut reader = image::ImageReader::new(std::io::Cursor::new(read(path)?)).with_guessed_format()?;
    let mut limits = image::Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(u16::MAX.into()), Some(u16::MAX.into()));
    reader.limits(limits);
    let picture = reader.decode().with_context(about)?.into_rgb8();
    Ok(CapturedPicture { size_px: [picture.width(), picture.height()], rgb: picture.into_raw() })
}

fn parse_rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(rate) if (0.1..=120.0).contains(&rate) => Ok(rate),
        _ => Err("expected a rate from 0.1 to 120 frames per second".to_owned()),
    }
}
