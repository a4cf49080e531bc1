//! `relief inspect dicomweb+...`: the series of a DICOM archive that match an address.

use std::process::ExitCode;

use anyhow::Context;
use relief_archive::{Archive, ArchiveAccess, ArchiveAddress, FoundSeries};
use serde::Serialize;

use crate::output::{print_json, say};
use relief_base::printable;

/// A series as `--json` shows it.
#[derive(Serialize)]
struct ListedSeries<'a> {
    address: String,
    #[serde(flatten)]
    series: &'a FoundSeries,
}

/// Lists the series; those that Relief loads are CT.
pub(super) fn run(
    address: &ArchiveAddress,
    access: &ArchiveAccess,
    shows_patients: bool,
    json: bool,
) -> anyhow::Result<ExitCode> {
    let archive = Archive::open(address, access)?;
    let mut found = archive.series(address).context("cannot list series")?;
    if !shows_patients {
        found.iter_mut().for_each(without_patient);
    }
    let listed: Vec<ListedSeries<'_>> = found
        .iter()
        .map(|series| {
            let place = address.of_series(&series.study_uid, &series.series_uid)?;
            Ok(ListedSeries { address: place.to_string(), series })
        })
        .collect::<anyhow::Result<_>>()?;
    if json {
        print_json(&listed)?;
    } else {
        print(&listed, shows_patients);
    }
    if listed.is_empty() {
        eprintln!("relief: no series of {} match", address.public_name());
        return Ok(ExitCode::FAILURE);
    }
    Ok(ExitCode::SUCCESS)
}

/// Descriptions are free text: they stay, because series are chosen by them.
fn without_patient(series: &mut FoundSeries) {
    series.patient_name.clear();
    series.patient_id.clear();
}

fn print(listed: &[ListedSeries<'_>], shows_patients: bool) {
    let mut study = "";
    for ListedSeries { address, series } in listed {
        if series.study_uid != study {
            study = &series.study_uid;
            let date = if series.study_date.is_empty() { "of unknown date" } else { &series.study_date };
            say!("study {} {}", printable(date), printable(&series.study_description));
            if shows_patients {
                say!("  patient {} {}", printable(&series.patient_id), printable(&series.patient_name));
            }
        }
        let count = series.instances.map_or("?".to_owned(), |count| count.to_string());
        let texts = [&series.modality, &series.body_part, &series.description].map(|text| printable(text));
        say!("  {count:>5} files  {}", texts.join("  ").trim_end());
        say!("  {address}");
    }
}
