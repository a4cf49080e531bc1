//! `relief doctor`: reports adapters, drivers and tools, missing ones, and how to install them.
//!
//! It looks at the environment, asks the graphics drivers, and renders a ball that is compared with
//! the f64 twin. Exit status: 0 when pictures can be rendered (warnings allowed), 1 when nothing
//! can render.

mod finding;
mod isolation;

use std::path::PathBuf;
use std::process::{Command, ExitCode};
use std::time::Instant;

use serde::Serialize;

use super::features::{FEATURES, Feature};
use super::output::{print_json, say};
use finding::{Finding, Mark};
use isolation::isolation_finding;
use relief_golden::compare;
use relief_golden::{Raster, Samples, Tolerance};
use relief_render::{
    AdapterChoice, AdapterDescription, AdapterKind, Gpu, GpuError, GpuLimits, RenderError, Renderer,
    SceneFile, adapters,
};
use relief_volume::{Orbit, Phantom};

/// Report adapters, drivers and tools, missing ones, and how to install them.
#[derive(Clone, Copy, Debug, clap::Args)]
#[command(after_help = "\
Examples:
  relief doctor                            a readable report
  relief doctor --json                     the same as one JSON object
  RELIEF_ADAPTER=software relief doctor    what is said of the software adapter")]
pub(super) struct DoctorArguments {
    /// Print the report as one JSON object
    #[arg(long)]
    json: bool,
}

/// How to get a driver.
const GET_A_DRIVER: [&str; 2] = [
    "install one: mesa-vulkan-drivers and libvulkan1 (Debian, Ubuntu), mesa-vulkan-drivers (Fedora)",
    "or, in a copy of the source, run scripts/setup-driver, then `. scripts/env.sh`",
];
const GET_A_LOADER: [&str; 2] = [
    "install it: libvulkan1 (Debian, Ubuntu), vulkan-loader (Fedora), vulkan-icd-loader (Arch)",
    "or, in a copy of the source, run scripts/setup-driver, then `. scripts/env.sh`",
];

const ANOTHER_ADAPTER: [&str; 1] =
    ["try another adapter (RELIEF_ADAPTER=software, or a part of a name above) or another driver"];

/// Mesa's software driver samples about three times faster from this release on.
const FAST_MESA: u32 = 25;

/// The picture of the self-test: large enough for a share of 0.1 % to mean pixels, quick
/// everywhere.
const SELF_TEST_SIZE_PX: [u32; 2] = [96, 72];
const SELF_TEST_VOXELS: usize = 48;

/// Everything that was found out.
#[derive(Debug, Serialize)]
struct DoctorReport {
    version: &'static str,
    can_render: bool,
    adapters: Vec<AdapterDescription>,
    chosen: Option<AdapterDescription>,
    limits: Option<GpuLimits>,
    self_test: Option<SelfTest>,
    findings: Vec<Finding>,
}

/// Result of the test picture.
#[derive(Debug, Serialize)]
struct SelfTest {
    passed: bool,
    /// The first frame: upload, compilation of the shaders, rays, read-back.
    first_frame_ms: f64,
    /// The second frame.
    frame_ms: f64,
    problems: Vec<String>,
}

pub(super) fn run(arguments: DoctorArguments) -> anyhow::Result<ExitCode> {
    let DoctorArguments { json } = arguments;
    let report = examine();
    if json {
        print_json(&report)?;
    } else {
        say!("{}", readable(&report).trim_end());
    }
    Ok(if report.can_render { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}

fn examine() -> DoctorReport {
    let adapters = adapters();
    let mut findings = vec![system_finding()];
    findings.extend(driver_file_findings());
    findings.extend(loader_finding(&adapters));
    findings.extend(adapters.iter().map(adapter_finding));
    if adapters.is_empty() {
        let found = "no graphics adapter: only what the processor's own ray caster does can be rendered";
        findings.push(Finding::new(Mark::Warn, "adapter", found.to_owned()).advise(GET_A_DRIVER));
    }
    let mut report = DoctorReport {
        version: env!("CARGO_PKG_VERSION"),
        can_render: false,
        adapters,
        chosen: None,
        limits: None,
        self_test: None,
        findings,
    };
    report.examine_choice();
    report.findings.push(features_finding());
    report.findings.push(isolation_finding());
    report
}

impl DoctorReport {
    /// Opens the adapter that every other subcommand would open, and renders with it.
    fn examine_choice(&mut self) {
        let wanted = std::env::var("RELIEF_ADAPTER").unwrap_or_default();
        let choice = AdapterChoice::parse(&wanted);
        let renderer = match Renderer::open(&choice) {
            Ok(renderer) => renderer,
            Err(error) => {
                self.findings.push(unopened_finding(&wanted, &error));
                return;
            }
        };
        let adapter = renderer.adapter().clone();
        let found = format!("{}: {}", adapter.name, reason(&choice, &adapter, &self.adapters));
        self.findings.push(Finding::new(Mark::Ok, "chosen", found));
        self.limits = renderer.gpu().map(Gpu::limits);
        self.findings.extend(self.limits.map(limits_finding));
        self.chosen = Some(adapter);
        self.examine_rendering(renderer);
    }

    fn examine_rendering(&mut self, renderer: Renderer) {
        match self_test(renderer) {
            Ok(test) => {
                self.can_render = test.passed;
                self.findings.push(test.finding());
                self.self_test = Some(test);
            }
            Err(error) => {
                let finding = Finding::new(Mark::Failed, "self-test", error.to_string());
                self.findings.push(finding.advise(ANOTHER_ADAPTER));
            }
        }
    }
}

fn unopened_finding(wanted: &str, error: &RenderError) -> Finding {
    match error {
        RenderError::Gpu(GpuError::NoAdapter { .. }) => {
            let found = format!("no adapter for RELIEF_ADAPTER={wanted}");
            let advice =
                ["unset RELIEF_ADAPTER, or set it to best, cpu, software, or a part of a name above"];
            Finding::new(Mark::Missing, "chosen", found).advise(advice)
        }
        _ => Finding::new(Mark::Failed, "chosen", error.to_string()).advise(ANOTHER_ADAPTER),
    }
}

fn system_finding() -> Finding {
    let (os, arch) = (std::env::consts::OS, std::env::consts::ARCH);
    match std::thread::available_parallelism() {
        Ok(threads) => Finding::new(Mark::Ok, "system", format!("{os} on {arch}, {threads} CPU threads")),
        Err(error) => {
            Finding::new(Mark::Warn, "system", format!("{os} on {arch}, CPU threads unknown: {error}"))
        }
    }
}

/// The variables that make the Vulkan loader use certain drivers.
fn driver_file_findings() -> Vec<Finding> {
    if !cfg!(target_os = "linux") {
        return Vec::new();
    }
    let mut findings = Vec::new();
    for what in ["VK_DRIVER_FILES", "VK_ICD_FILENAMES", "VK_ADD_DRIVER_FILES"] {
        let files = std::env::var_os(what).unwrap_or_default();
        for file in std::env::split_paths(&files).filter(|file| !file.as_os_str().is_empty()) {
            let found = file.display().to_string();
            findings.push(if file.exists() {
                Finding::new(Mark::Ok, what, found)
            } else {
                let advice =
                    ["unset the variable to use the system's drivers, or set it by `. scripts/env.sh`"];
                Finding::new(Mark::Missing, what, format!("{found} does not exist")).advise(advice)
            });
        }
    }
    if findings.is_empty() {
        let found = "not set: the system's own drivers are used".to_owned();
        findings.push(Finding::new(Mark::Ok, "VK_DRIVER_FILES", found));
    }
    findings
}

/// Whether the Vulkan loader is installed. `None` on systems with another graphics interface.
fn loader_finding(adapters: &[AdapterDescription]) -> Option<Finding> {
    if !cfg!(target_os = "linux") {
        return None;
    }
    let in_use = adapters.iter().any(|adapter| adapter.backend.eq_ignore_ascii_case("vulkan"));
    Some(match (find_loader(), in_use) {
        (Some(path), _) => Finding::new(Mark::Ok, "Vulkan loader", path.display().to_string()),
        (None, true) => Finding::new(Mark::Ok, "Vulkan loader", "in use".to_owned()),
        (None, false) => {
            let found = format!("{LOADER} is neither in LD_LIBRARY_PATH nor among the system's libraries");
            Finding::new(Mark::Missing, "Vulkan loader", found).advise(GET_A_LOADER)
        }
    })
}

const LOADER: &str = "libvulkan.so.1";

/// The places in which the dynamic linker searches for the loader: LD_LIBRARY_PATH first, then its
/// cache.
fn find_loader() -> Option<PathBuf> {
    let folders = std::env::var_os("LD_LIBRARY_PATH").unwrap_or_default();
    let in_path =
        std::env::split_paths(&folders).map(|folder| folder.join(LOADER)).find(|path| path.exists());
    in_path.or_else(|| {
        let cache = linker_cache()?;
        let entry = cache.lines().find(|line| line.trim_start().starts_with(LOADER))?;
        entry.split_once("=> ").map(|(_, path)| PathBuf::from(path.trim()))
    })
}

fn linker_cache() -> Option<String> {
    // Users other than root often have no sbin in their path.
    let run = |program: &str| Command::new(program).arg("-p").output().ok();
    let output = ["ldconfig", "/sbin/ldconfig", "/usr/sbin/ldconfig"].into_iter().find_map(run)?;
    Some(String::from_utf8_lossy(&output.stdout).into_owned())
}

fn adapter_finding(adapter: &AdapterDescription) -> Finding {
    let kind = match adapter.kind {
        AdapterKind::Processor => "processor",
        AdapterKind::Software => "software",
        AdapterKind::Other => "unclassified",
        AdapterKind::Virtual => "virtual GPU",
        AdapterKind::Integrated => "integrated GPU",
        AdapterKind::Discrete => "discrete GPU",
    };
    let found = format!("{}, {kind}, {}, driver {}", adapter.name, adapter.backend, adapter.driver);
    match mesa_release(&adapter.driver) {
        Some(release) if adapter.kind == AdapterKind::Software && release < FAST_MESA => {
            Finding::new(Mark::Warn, "adapter", found).advise([
                "its Mesa is older than 25: frames take about three times longer, with the same pictures",
                "scripts/setup-driver fetches a newer one on Debian 12; then `. scripts/env.sh`",
            ])
        }
        _ => Finding::new(Mark::Ok, "adapter", found),
    }
}

/// The first number of Mesa's version in a driver's description.
fn mesa_release(driver: &str) -> Option<u32> {
    let (_, version) = driver.split_once("Mesa ")?;
    version.split(|letter: char| !letter.is_ascii_digit()).next()?.parse().ok()
}

/// Why an adapter was chosen.
fn reason(choice: &AdapterChoice, chosen: &AdapterDescription, adapters: &[AdapterDescription]) -> String {
    match choice {
        AdapterChoice::Best if chosen.kind == AdapterKind::Processor => {
            "there is no graphics card".to_owned()
        }
        AdapterChoice::Processor => "RELIEF_ADAPTER asks for the processor".to_owned(),
        AdapterChoice::Best if adapters.len() == 1 => "the only one".to_owned(),
        AdapterChoice::Best => format!("the most capable of {}", adapters.len()),
        AdapterChoice::Software => "RELIEF_ADAPTER asks for a software adapter".to_owned(),
        AdapterChoice::Named(part) => format!("RELIEF_ADAPTER asks for {part:?}"),
    }
}

fn limits_finding(limits: GpuLimits) -> Finding {
    let voxels = if limits.norm16_textures {
        "16-bit voxels"
    } else {
        "no 16-bit normalised textures: voxels become half floats, good to 2 HU above 2048 HU"
    };
    let found = format!(
        "volumes up to {side} voxels a side, buffers up to {} MiB, {voxels}",
        limits.storage_bytes >> 20,
        side = limits.texture_3d_side
    );
    Finding::new(Mark::Ok, "limits", found)
}

/// Renders a ball twice and compares it with the f64 twin.
fn self_test(mut renderer: Renderer) -> Result<SelfTest, RenderError> {
    let volume = Phantom::sphere(SELF_TEST_VOXELS).expect("a size within the range of phantoms").volume;
    let scene = SceneFile::default().with_preset("bone").with_size(SELF_TEST_SIZE_PX);
    let orbit = Orbit { azimuth_deg: 30.0, elevation_deg: 20.0, ..Orbit::default() };
    let request = scene.resolve(volume.grid(), &orbit).expect("a preset and a size within range").request;
    let start = Instant::now();
    let frame = renderer.render(&volume, &request)?;
    let first_frame_ms = start.elapsed().as_secs_f64() * 1e3;
    let frame_ms = renderer.render(&volume, &request)?.timings.render_ms;
    let twin = relief_render::render_reference(&volume, &request)?;
    let raster = |samples| Raster { size_px: SELF_TEST_SIZE_PX, samples };
    let pairs = [
        (Samples::Color(twin.color_rgba), Samples::Color(frame.color_rgba)),
        (Samples::DepthMm(twin.depth_mm), Samples::DepthMm(frame.depth_mm)),
    ];
    let problems: Vec<String> = pairs
        .into_iter()
        .map(|(expected, actual)| compare(&raster(expected), &raster(actual), &Tolerance::TWIN))
        .flat_map(|comparison| comparison.mismatches)
        .map(|mismatch| mismatch.to_string())
        .collect();
    Ok(SelfTest { passed: problems.is_empty(), first_frame_ms, frame_ms, problems })
}

impl SelfTest {
    fn finding(&self) -> Finding {
        let Self { first_frame_ms, frame_ms, .. } = self;
        if self.passed {
            let found = format!(
                "a ball is rendered as computed in 64 bits; {first_frame_ms:.0} ms for the first frame, \
                 {frame_ms:.0} ms for the next"
            );
            return Finding::new(Mark::Ok, "self-test", found);
        }
        let found = format!("a rendered ball is not as computed in 64 bits: {}", self.problems.join("; "));
        Finding::new(Mark::Failed, "self-test", found).advise(ANOTHER_ADAPTER)
    }
}

/// The features of this build. What it lacks is no defect.
fn features_finding() -> Finding {
    let (built, lacking): (Vec<Feature>, Vec<Feature>) =
        FEATURES.into_iter().partition(|feature| feature.is_built);
    let built: Vec<&str> = built.iter().map(|feature| feature.name).collect();
    let found = if built.is_empty() { "those of every build".to_owned() } else { built.join(", ") };
    let advice = lacking.iter().map(|feature| format!("--features {} adds {}", feature.name, feature.adds));
    Finding::new(Mark::Ok, "features", found).advise(advice)
}

fn readable(report: &DoctorReport) -> String {
    let mut text = format!("relief {}\n\n", report.version);
    for Finding { mark, what, found, advice } in &report.findings {
        let mark = match mark {
            Mark::Ok => "ok",
            Mark::Warn => "warn",
            Mark::Missing => "MISSING",
            Mark::Failed => "FAILED",
        };
        text += &format!("{mark:<8} {what:<16} {found}\n");
        for advice in advice {
            text += &format!("{:25} -> {advice}\n", "");
        }
    }
    let verdict = match (&report.chosen, report.can_render) {
        (Some(adapter), true) => format!("Relief renders on {}.", adapter.name),
        _ => "Relief cannot render here; see above for the missing parts and how to install them.".to_owned(),
    };
    text + "\n" + &verdict + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_old_software_mesa_is_warned_of_and_a_gpus_is_not() {
        let adapter = |driver: &str, kind| AdapterDescription {
            name: "adapter".to_owned(),
            driver: driver.to_owned(),
            backend: "vulkan".to_owned(),
            kind,
        };
        for (driver, kind, mark) in [
            ("llvmpipe Mesa 22.3.6 (LLVM 15.0.6)", AdapterKind::Software, Mark::Warn),
            ("llvmpipe Mesa 25.0.7-2~bpo12+1 (LLVM 15.0.6)", AdapterKind::Software, Mark::Ok),
            ("radv Mesa 22.3.6", AdapterKind::Discrete, Mark::Ok),
            ("SwiftShader 5.0.0", AdapterKind::Software, Mark::Ok),
        ] {
            assert_eq!(adapter_finding(&adapter(driver, kind)).mark, mark, "{driver}");
        }
    }
}
