//! The command line: arguments in, library calls, readable reports out.
//!
//! Each subcommand has a file with its arguments and a `run`. Only this module writes to stdout and
//! stderr, reads the environment and decides exit statuses: 0 done, 1 failed, 2 wrong arguments.
#![expect(clippy::print_stderr, reason = "the command line is where output belongs")]

mod adapter;
mod against_true;
mod annotate;
mod annotated;
mod archive;
mod audit;
mod batch;
mod bench;
mod bucket;
mod calibrate;
mod capacity;
mod choices;
mod client;
mod convert;
mod doctor;
mod eye;
mod features;
mod frame_file;
mod golden;
mod headless;
mod inspect;
mod isolation;
mod labels;
mod light;
mod manual;
mod memory;
mod output;
mod panel;
mod phantom;
mod plot;
mod presets;
mod preview;
mod progress;
mod quilt;
#[cfg(feature = "archives")]
mod receive;
mod render;
mod scene;
#[cfg(feature = "archives")]
mod send;
mod series;
mod serve;
mod slice;
mod source;
mod stop;
mod text_file;
mod token;
mod tool_placement;
#[cfg(feature = "traces")]
mod traces;
mod track;
mod transfer;
mod views;

use std::io::IsTerminal;
use std::process::ExitCode;

#[cfg(feature = "traces")]
use anyhow::Context;
use clap::{CommandFactory, Parser, Subcommand};
use tracing_subscriber::layer::SubscriberExt;
use tracing_subscriber::util::SubscriberInitExt;
use tracing_subscriber::{EnvFilter, Layer};

/// Headless CT volume rendering, in colour and depth, for glasses-free 3D displays.
#[derive(Debug, Parser)]
#[command(name = "relief", version, about, long_about = None, after_help = AFTER_HELP)]
struct CommandLine {
    #[command(subcommand)]
    command: Command,
}

const AFTER_HELP: &str = "\
Examples:
  relief phantom --kind head --out head          make a CT series of a procedural head
  relief render --series head --preset bone --out head.png
  relief inspect head.png                        decode the 2D-plus-depth header of a frame
  relief preview head.png --out wiggle.png       what a display makes of a frame, as an animation
  relief convert photo.png --estimate-depth --out frame.png   a plain picture as a frame
  relief serve --series head                     serve it; the page is at the printed address
  relief client --server http://HOST:8080        show a live session on a 3D display
  relief track --reports hidraw                  poses of a Wiimote that sees a beacon
  relief annotate --db ann.db list               landmarks and structures, and who placed them

Log detail is set by RELIEF_LOG (error, warn, info, debug, trace).
Exit status: 0 done, 1 failed, 2 wrong arguments.";

#[derive(Debug, Subcommand)]
enum Command {
    Phantom(phantom::PhantomArguments),
    Inspect(inspect::InspectArguments),
    Render(render::RenderArguments),
    Preview(preview::PreviewArguments),
    Convert(convert::ConvertArguments),
    Presets(presets::PresetsArguments),
    Bench(bench::BenchArguments),
    Serve(serve::ServeArguments),
    Client(client::arguments::ClientArguments),
    Track(track::TrackArguments),
    Calibrate(calibrate::CalibrateArguments),
    Annotate(annotate::AnnotateArguments),
    /// Read an untrusted file for a server
    #[cfg(target_os = "linux")]
    #[command(hide = true)]
    DecodeWorker,
    Token(token::TokenArguments),
    Audit(audit::AuditArguments),
    #[cfg(feature = "archives")]
    Send(send::SendArguments),
    #[cfg(feature = "archives")]
    Receive(receive::ReceiveArguments),
    Batch(batch::BatchArguments),
    Golden(golden::GoldenArguments),
    Doctor(doctor::DoctorArguments),
    Manual(manual::ManualArguments),
}

/// Parses the command line, runs the subcommand and reports errors.
#[must_use]
pub fn main() -> ExitCode {
    let arguments = match CommandLine::try_parse() {
        Ok(arguments) => arguments,
        Err(error) => match features::explain(&error) {
            Some(message) => {
                eprintln!("relief: {message}");
                return ExitCode::from(2);
            }
            None => error.exit(), // with status 2 on wrong arguments
        },
    };
    #[cfg(target_os = "linux")]
    if matches!(arguments.command, Command::DecodeWorker) {
        return relief_isolation::serve(); // before anything starts a thread or opens a file
    }
    headless::leave_window_systems();
    let _traces = match start_logging(&arguments.command) {
        Ok(traces) => traces, // sent until the end
        Err(error) => {
            eprintln!("relief: {}", output::report(&error));
            return ExitCode::FAILURE;
        }
    };
    let outcome = match arguments.command {
        Command::Phantom(arguments) => phantom::run(arguments),
        Command::Inspect(arguments) => inspect::run(arguments),
        Command::Render(arguments) => render::run(&arguments),
        Command::Preview(arguments) => preview::run(&arguments),
        Command::Convert(arguments) => convert::run(&arguments),
        Command::Presets(arguments) => presets::run(&arguments),
        Command::Bench(arguments) => bench::run(arguments),
        Command::Serve(arguments) => serve::run(&arguments),
        Command::Client(arguments) => client::run(&arguments),
        Command::Track(arguments) => track::run(arguments),
        Command::Calibrate(arguments) => calibrate::run(&arguments),
        Command::Token(arguments) => token::run(arguments),
        Command::Audit(arguments) => audit::run(&arguments),
        #[cfg(target_os = "linux")]
        Command::DecodeWorker => unreachable!("it has returned above"),
        Command::Annotate(arguments) => annotate::run(&arguments),
        #[cfg(feature = "archives")]
        Command::Send(arguments) => send::run(&arguments),
        #[cfg(feature = "archives")]
        Command::Receive(arguments) => receive::run(&arguments),
        Command::Batch(arguments) => batch::run(arguments),
        Command::Golden(arguments) => golden::run(arguments),
        Command::Doctor(arguments) => doctor::run(arguments),
        Command::Manual(arguments) => manual::run(&arguments, CommandLine::command()),
    };
    let failed = |error| {
        eprintln!("relief: {}", output::report(&error));
        ExitCode::FAILURE
    };
    match (outcome, output::stdout_failure()) {
        (Ok(_), Some(error)) => failed(anyhow::anyhow!("cannot write to stdout: {error}")),
        (outcome, _) => outcome.unwrap_or_else(failed),
    }
}

/// A level alone is that of Relief's own crates: at `debug` and `trace` libraries log every call.
fn directives(setting: &str) -> String {
    match setting.parse::<tracing::Level>() {
        Ok(level) if level > tracing::Level::WARN => format!("warn,relief={level}"),
        _ => setting.to_owned(),
    }
}

/// The way to a collector of traces, where the command line names one.
#[cfg(feature = "traces")]
fn open_traces(command: &Command) -> anyhow::Result<Option<traces::Traces>> {
    let Command::Serve(arguments) = command else { return Ok(None) };
    // An empty variable of the environment is one that is not set.
    let url = arguments.traces.as_deref().filter(|url| !url.is_empty());
    let opened = url.map(traces::Traces::open).transpose();
    opened.context("--traces cannot be used")
}

/// Logs go to stderr, because stdout carries results only. Returns a guard that has to live until
/// the end.
fn start_logging(command: &Command) -> anyhow::Result<impl Sized + use<>> {
    let usual = || EnvFilter::new("warn,relief_cli=info");
    let filter = match std::env::var("RELIEF_LOG") {
        Ok(setting) if !setting.is_empty() => {
            EnvFilter::builder().parse(directives(&setting)).unwrap_or_else(|error| {
                eprintln!(
                    "warning: RELIEF_LOG is {setting:?}, allowed: a level or directives of tracing: {error}"
                );
                usual()
            })
        }
        _ => usual(),
    };
    let colored = std::io::stderr().is_terminal();
    let log = tracing_subscriber::fmt::layer().with_ansi(colored).with_writer(std::io::stderr);
    let subscriber = tracing_subscriber::registry().with(log.with_filter(filter));
    #[cfg(feature = "traces")]
    {
        let traces = open_traces(command)?;
        subscriber.with(traces.as_ref().map(traces::Traces::layer)).init();
        Ok(traces)
    }
    #[cfg(not(feature = "traces"))]
    {
        let _ = command;
        subscriber.init();
        Ok(())
    }
}
