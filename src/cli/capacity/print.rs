//! The figures of a capacity as sentences, and as the tables of docs/CAPACITY.md.

use std::fmt::Write;

use serde::Serialize;

use relief_study::{Capacity, CapacityMeasurement, FrameRates, GroupNeeds, ViewerHabits};

/// The JSON form, documented in docs/CAPACITY.md.
#[derive(Debug, Serialize)]
pub(super) struct CapacityReport {
    pub(super) measured: CapacityMeasurement,
    pub(super) habits: ViewerHabits,
    pub(super) carried: Capacity,
    /// For 1 to 10,000 viewers; empty where this machine is too slow for one.
    pub(super) needed: Vec<GroupNeeds>,
}

/// For a terminal.
pub(super) fn text(report: &CapacityReport) -> String {
    let CapacityReport { measured, habits, carried, needed } = report;
    let mut text = format!(
        "{} ({}), {} cores, {} build\n",
        measured.adapter, measured.driver, measured.cores, measured.build
    );
    let mut line = |what: &str, frames: &FrameRates| {
        let FrameRates { per_s, size_px: [width, height], bytes, render_ms, encode_ms } = frames;
        let kb = bytes / 1e3;
        let _ = writeln!(
            text,
            "{what}: {per_s:.1} frames/s of {width}x{height} (render {render_ms:.1} ms, encode {encode_ms:.1} ms, {kb:.0} kB)"
        );
    };
    line("moving", &measured.moving);
    line("still, lossless", &measured.still);
    line("by request, PNG", &measured.view);
    let [nx, ny, nz] = measured.dims;
    let _ = writeln!(
        text,
        "memory: a volume of {nx}x{ny}x{nz} takes {:.0} MiB and {:.0} MiB of the adapter's",
        measured.voxels_mib, measured.adapter_mib
    );
    let _ =
        writeln!(text, "annotations: {:.0} edits/s of one writer, each on the disk", measured.edits_per_s);
    let share = habits.moving_share * 100.0;
    if carried.viewers == 0 {
        let _ = writeln!(
            text,
            "this machine does not give even one viewer {} frames/s while moving",
            habits.viewer_fps
        );
    } else {
        let _ = writeln!(
            text,
            "carries {} viewers at {} frames/s who move {share:.0} % of the time: {:.0} % of its time, too many at once {:.1} % of it",
            carried.viewers,
            habits.viewer_fps,
            carried.load * 100.0,
            carried.crowded * 100.0
        );
    }
    let _ = write!(text, "or {:.0} views per hour by request", carried.views_per_hour);
    for group in needed {
        let _ = write!(
            text,
            "\n{} viewers: {} servers, {:.1} Mbit/s ({:.1} at peak), {:.0} MiB a server, {:.1} edits/s",
            group.viewers,
            group.servers,
            group.mean_mbit_s,
            group.peak_mbit_s,
            group.server_mib,
            group.edits_per_s
        );
    }
    text
}

/// For docs/CAPACITY.md.
pub(super) fn markdown(report: &CapacityReport) -> String {
    let CapacityReport { measured, habits, carried, needed } = report;
    let [nx, ny, nz] = measured.dims;
    let mut text = format!(
        "Measured by `relief bench --capacity --markdown`: {} ({}), {} cores, {} build, a volume of {nx}x{ny}x{nz}.\n\n",
        measured.adapter, measured.driver, measured.cores, measured.build
    );
    text += "| frames | size | frames/s | render, ms | encode on one core, ms | kB |\n|---|---|---|---|---|---|\n";
    for (what, frames) in [
        ("moving: JPEG, disparity", measured.moving),
        ("still: lossless", measured.still),
        ("by request: PNG", measured.view),
    ] {
        let FrameRates { per_s, size_px: [width, height], bytes, render_ms, encode_ms } = frames;
        let kb = bytes / 1e3;
        let _ = writeln!(
            text,
            "| {what} | {width}x{height} | {per_s:.1} | {render_ms:.1} | {encode_ms:.1} | {kb:.0} |"
        );
    }
    let _ = writeln!(
        text,
        "\n| one server | |\n|---|---|\n| viewers at {} frames/s who move {:.0} % of the time | {} |",
        habits.viewer_fps,
        habits.moving_share * 100.0,
        carried.viewers
    );
    for (what, figure) in [
        ("share of its time that they take", format!("{:.0} %", carried.load * 100.0)),
        ("share of the time in which too many move at once", format!("{:.1} %", carried.crowded * 100.0)),
        ("a viewer is sent", format!("{:.2} Mbit/s on average", carried.viewer_mbit_s)),
        ("views per hour by request, without live viewers", format!("{:.0}", carried.views_per_hour)),
        (
            "memory of a volume: voxels, adapter",
            format!("{:.0} MiB, {:.0} MiB", measured.voxels_mib, measured.adapter_mib),
        ),
        (
            "memory of the process before",
            measured.base_mib.map_or_else(|| "unknown".to_owned(), |mib| format!("{mib:.0} MiB")),
        ),
        ("edits per second in SQLite, one writer", format!("{:.0}", measured.edits_per_s)),
    ] {
        let _ = writeln!(text, "| {what} | {figure} |");
    }
    text += "\n| viewers | servers, one spare | Mbit/s | at peak | volumes | memory of a server | edits/s | events read/s | connections of nginx |\n|---|---|---|---|---|---|---|---|---|\n";
    for group in needed {
        let _ = writeln!(
            text,
            "| {} | {} | {:.1} | {:.1} | {} | {:.1} GiB | {:.2} | {:.2} | {} |",
            group.viewers,
            group.servers,
            group.mean_mbit_s,
            group.peak_mbit_s,
            group.volumes,
            group.server_mib / 1024.0,
            group.edits_per_s,
            group.events_read_per_s,
            group.connections
        );
    }
    if needed.is_empty() {
        let _ = writeln!(
            text,
            "\nThis machine does not give even one viewer {} frames/s while moving.",
            habits.viewer_fps
        );
    }
    text.trim_end().to_owned()
}
