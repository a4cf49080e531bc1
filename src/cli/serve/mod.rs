//! `relief serve`: an HTTP server with its web pages; runs until a signal stops it.
//!
//! The address is printed as soon as it answers; series load behind it, and `/readyz` says when
//! frames can be had.

#[cfg(feature = "archives")]
mod archives;
mod faults;
mod identity;
mod load;
mod readers;
#[cfg(feature = "archives")]
mod receive;
pub(crate) mod series;

use std::net::{IpAddr, SocketAddr};
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use anyhow::Context;
use futures_util::FutureExt;
use tokio::net::TcpSocket;
use tokio::sync::oneshot;

use crate::adapter::AdapterArguments;
use crate::bucket::CopiesArguments;
use crate::isolation::Isolation;
use crate::memory::parse_bytes;
use crate::output::say;
use crate::source::SeriesOptions;
use crate::stop::stop_signal;
use crate::track::scene::{read_beacon, read_camera};
use faults::Fault;
use identity::IdentityArguments;
use load::{SeriesLoader, load_behind, places};
use readers::Readers;
use relief_base::sha256_of_file;
use relief_server::{
    Admission, AllowedHosts, Config, ConnectionLimits, LiveConfig, Server, Shutdown, Tls, UploadLimits,
};
use relief_session::{NameSource, QueueConfig, RenderService};
use relief_store::Store;
use series::of_buckets;

/// The longest time of the end of live sessions.
const SESSIONS_PATIENCE: Duration = Duration::from_secs(2);
/// The longest time in which running requests may finish. With sessions and the log, a server is
/// gone within ten seconds of its signal.
const DRAIN: Duration = Duration::from_secs(5);
/// Connections that may wait to be accepted.
const BACKLOG: u32 = 1024;

/// Serve frames over HTTP, with a web page that shows them.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  relief serve --series head                     the page is at the printed address
  relief serve --series abdomen --labels organs.seg.nrrd
  relief serve --series head --annotations head.db
  relief serve --series chest --series head --listen 127.0.0.1:0
  relief serve --series s3://archive/ct --cache /var/cache/relief     series of a bucket; AWS_... have credentials and endpoint
  relief serve --series 'dicomweb+https://ct-server/dicom-web?PatientID=4711'     series of a DICOM archive
  relief serve --archive pacs=dicomweb+https://ct-server/dicom-web     series that are searched and loaded on the page
  relief serve --receive inbox --receive-caller PACS@10.0.0.7 --receive-listen 10.0.0.5:11112     series that arrive by the DICOM network
  relief serve --series head --annotations postgres://relief@db/relief --listen-when-loaded   one of several servers
  curl -o frame.png 'http://127.0.0.1:8080/v1/volumes/ID/frame?preset=bone&azimuth_deg=30'

  relief serve --series head --listen 0.0.0.0:8443 --token-file tokens --tls-self-signed tls   for other machines

Another address than loopback needs to know who calls: --token-file (see relief token), client certificates, a trusted proxy, or
--insecure.")]
pub(super) struct ServeArguments {
    /// CT series to serve: a folder, a file, a DICOMDIR or a zip; s3://BUCKET/PREFIX: each folder,
    /// zip, .nii and .nrrd below it; or the address of a DICOM archive,
    /// dicomweb+https://HOST/ROOT/studies/UID or ...?ATTRIBUTE=VALUE: each CT series that matches;
    /// may be given several times
    #[arg(long, value_name = "PATH")]
    series: Vec<PathBuf>,
    /// Label map of the series in the same place: of the first --series, of the second, ...
    #[arg(long, value_name = "FILE")]
    labels: Vec<PathBuf>,
    #[command(flatten)]
    options: SeriesOptions,
    #[command(flatten)]
    copies: CopiesArguments,
    /// A DICOM archive that the page searches and loads series from, by this name; for callers who
    /// may add volumes; may be given several times
    #[cfg(feature = "archives")]
    #[arg(long, value_name = "NAME=ADDRESS")]
    archive: Vec<archives::NamedArchive>,
    /// Let callers who may annotate store pictures and annotations in the archives of --archive
    #[cfg(feature = "archives")]
    #[arg(long, requires = "archive")]
    archive_results: bool,
    #[cfg(feature = "archives")]
    #[command(flatten)]
    reception: receive::ReceptionArguments,
    /// Log of annotations: a file, sqlite:FILE or postgres://USER@HOST/DATABASE; created if it does
    /// not exist
    #[arg(long, value_name = "PLACE", env = "RELIEF_ANNOTATIONS", hide_env_values = true)]
    annotations: Option<String>,
    /// Address to listen on; port 0 takes a free one
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8080")]
    listen: SocketAddr,
    /// Listen only when all series are loaded: a proxy before several servers sends requests to the
    /// others until then
    #[arg(long)]
    listen_when_loaded: bool,
    /// Also accept this name in the header Host. Without it, a loopback address accepts loopback
    /// names; any other accepts addresses of digits and the machine's own name, too
    #[arg(long, value_name = "NAME")]
    allow_host: Vec<String>,
    /// Whether clients may upload series; `auto` is on for a loopback address, and where callers need
    /// the scope admin for it
    #[arg(long, value_enum, default_value_t = Uploads::Auto)]
    uploads: Uploads,
    /// Where uploads and series from buckets are read: in a child process without rights to files,
    /// network and programs, or in the server's own
    #[arg(long, value_enum, default_value_t = Isolation::DEFAULT)]
    isolation: Isolation,
    #[command(flatten)]
    adapter: AdapterArguments,
    /// Memory for voxels and label maps of all volumes, such as 8GiB; series that are not shown are
    /// read again when they are
    #[arg(long, value_name = "BYTES", default_value = "16GiB", value_parser = parse_bytes)]
    memory: u64,
    /// Call volumes by the descriptions of their series and the dates of the studies, on the pages,
    /// over HTTP and on stderr. A description is free text and may name the patient
    #[arg(long)]
    show_patient_data: bool,
    /// Regions and meshes that the log of annotations may have together; more are refused
    #[arg(long, value_name = "BYTES", default_value = "64GiB", value_parser = parse_bytes)]
    contents: u64,
    /// Orders that may wait while one renders; more are answered with 503
    #[arg(long, value_name = "N", default_value_t = 32, value_parser = clap::value_parser!(u16).range(1..=4096))]
    queue: u16,
    /// Live sessions and plain live viewers at a time
    #[arg(long, value_name = "N", default_value_t = 128, value_parser = clap::value_parser!(u16).range(1..=4096))]
    sessions: u16,
    /// Camera of the Wiimotes whose reports clients relay: OpenCV or ROS YAML; a typical one
    /// otherwise
    #[arg(long, value_name = "CAM.yaml")]
    sensor: Option<PathBuf>,
    /// Send spans of requests and frames to this OpenTelemetry collector: OTLP over HTTP, such as
    /// http://127.0.0.1:4318
    #[cfg(feature = "traces")]
    #[arg(long, value_name = "URL", env = "OTEL_EXPORTER_OTLP_ENDPOINT")]
    pub(super) traces: Option<String>,
    /// Bring about a failure, to see that the server recovers; may be given several times
    #[arg(long = "fault", value_name = "KIND=VALUE", hide = true)]
    faults: Vec<Fault>,
    /// Beacon that they look at; the recommended one otherwise
    #[arg(long, value_name = "B.toml")]
    beacon: Option<PathBuf>,
    // The last one: its heading is that of all arguments behind it.
    #[command(flatten)]
    identity: IdentityArguments,
}

/// The callers that may add volumes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
enum Uploads {
    /// On for a loopback address and where callers are recognised, else off
    Auto,
    /// Everyone who can reach the address
    On,
    /// No client: uploads are refused
    Off,
}

pub(super) fn run(arguments: &ServeArguments) -> anyhow::Result<ExitCode> {
    let copies = arguments.copies.copies()?;
    #[cfg_attr(not(feature = "archives"), expect(unused_mut, reason = "nothing is received"))]
    let mut places = places(&arguments.series, &arguments.labels, &copies)?;
    #[cfg(feature = "archives")]
    places.extend(arguments.reception.kept()?);
    let admission = arguments.identity.admission(arguments.listen)?;
    let audit = arguments.identity.audit()?;
    let backend = arguments.adapter.open_backend()?;
    let limits = backend.renderer().volume_limits();
    let (adapter, identity) = (backend.renderer().adapter().to_string(), backend.renderer().identity());
    let backend = backend.with_faults(faults::of_device(&arguments.faults));
    faults::begin_clock(&arguments.faults);
    let queue = QueueConfig { capacity: arguments.queue.into(), ..QueueConfig::default() };
    let service = Arc::new(RenderService::start(backend, queue)?);
    let config = config(arguments, adapter, &identity, admission)?;
    let names = config.allowed_hosts.as_ref().map(|hosts| hosts.names.clone()).unwrap_or_default();
    let tls = arguments.identity.tls(&names)?;
    let readers = Readers::new(arguments.isolation, config.uploads.is_some(), limits)?;
    let mut server = Server::new(Arc::clone(&service), readers.series, config);
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build()?;
    let log = match &arguments.annotations {
        Some(place) => Some(
            runtime
                .block_on(Store::open_with(place, faults::of_store(&arguments.faults)))
                .context("--annotations cannot be used")?,
        ),
        None => None,
    };
    if let Some(log) = &log {
        server = server.annotating(log.clone());
    }
    if let Some(audit) = audit {
        server = server.audited(audit);
    }
    let options = arguments.options.clone();
    let loader =
        Arc::new(SeriesLoader { copies, options, limits, of_buckets: of_buckets(arguments.isolation)? });
    #[cfg(feature = "archives")]
    if !arguments.archive.is_empty() {
        let archives = archives::SearchedArchives::new(
            &arguments.archive,
            Arc::clone(&loader),
            arguments.archive_results,
        )?;
        server = server.searching(Box::new(archives))?;
    }
    let server = server.reading_labels(readers.labels).reading_annotations(readers.annotations);
    let server = Arc::new(server);
    server.expect_volumes(places.len());
    #[cfg(feature = "archives")]
    let reception = arguments.reception.start()?;
    #[cfg(feature = "archives")]
    let arrivals = reception.as_ref().map(receive::Reception::arrivals);
    #[cfg(not(feature = "archives"))]
    let arrivals = None;
    let load = |server| load_behind(places, loader, server, arrivals);
    let outcome = runtime.block_on(serve(arguments, tls, server, load));
    #[cfg(feature = "archives")]
    drop(reception);
    service.shut_down();
    if let Some(log) = log {
        runtime.block_on(log.close());
    }
    // The server does not wait for an upload that is still being read when the time is up.
    runtime.shutdown_timeout(Duration::from_secs(1));
    outcome
}

/// Binds, loads and serves until a signal, or until a series turns out to be unusable.
async fn serve(
    arguments: &ServeArguments,
    tls: Option<Arc<Tls>>,
    server: Arc<Server>,
    load: impl FnOnce(Arc<Server>) -> anyhow::Result<oneshot::Receiver<anyhow::Error>>,
) -> anyhow::Result<ExitCode> {
    let listen = arguments.listen;
    let socket = bound(listen).with_context(|| format!("cannot listen on {listen}"))?;
    let mut signal = Box::pin(stop_signal()?); // before the address is printed
    let mut failed = load(Arc::clone(&server))?.fuse();
    let probes = match arguments.identity.probe_listen {
        Some(address) => Some(probes(address, Arc::clone(&server))?),
        None => None,
    };
    if arguments.listen_when_loaded {
        tokio::select! {
            () = &mut signal => return Ok(ExitCode::SUCCESS),
            failed = &mut failed => if let Ok(error) = failed { return Err(error) },
        }
    }
    let follower = server.follow_annotations().await;
    let listener = socket.listen(BACKLOG).with_context(|| format!("cannot listen on {listen}"))?;
    let address = listener.local_addr()?;
    let scheme = if tls.is_some() { "https" } else { "http" };
    say!("listening on {scheme}://{}/", reachable(address));
    arguments.identity.warn(address, tls.is_some());
    let mut failure = None;
    let sessions = Arc::clone(&server);
    let stop = async {
        tokio::select! {
            () = &mut signal => eprintln!("stopping: finishing open requests"),
            Ok(error) = &mut failed => failure = Some(error),
        }
        sessions.close_sessions(SESSIONS_PATIENCE).await;
    };
    let limits = ConnectionLimits {
        unlimited: arguments.identity.unlimited(),
        drain_timeout: DRAIN,
        ..ConnectionLimits::default()
    };
    let drained = relief_server::serve(listener, tls, relief_server::app(server), limits, stop).await;
    if let Some(probes) = probes {
        probes.abort();
    }
    if drained == Shutdown::CutOff {
        eprintln!("warning: some requests were cut off");
    }
    follower.abort();
    let _ = follower.await; // it has a connection to the log, which is closed next
    failure.map_or(Ok(ExitCode::SUCCESS), Err)
}

/// Answers probes and monitoring on a listener of their own.
fn probes(address: SocketAddr, server: Arc<Server>) -> anyhow::Result<tokio::task::JoinHandle<()>> {
    let listening = bound(address).and_then(|socket| socket.listen(BACKLOG));
    let listener = listening.with_context(|| format!("cannot listen on {address} (--probe-listen)"))?;
    eprintln!("probes: http://{}/readyz", listener.local_addr()?);
    let app = relief_server::probes(server);
    let limits = ConnectionLimits { connections: 64, ..ConnectionLimits::default() };
    let served = async move {
        relief_server::serve(listener, None, app, limits, std::future::pending()).await;
    };
    Ok(tokio::spawn(served))
}

/// A socket bound to its address that does not accept connections yet.
fn bound(address: SocketAddr) -> std::io::Result<TcpSocket> {
    let socket = if address.is_ipv4() { TcpSocket::new_v4()? } else { TcpSocket::new_v6()? };
    // As for any listener on Unix: the address of a server that was stopped is free at once.
    #[cfg(unix)]
    socket.set_reuseaddr(true)?;
    socket.bind(address)?;
    Ok(socket)
}

fn config(
    arguments: &ServeArguments,
    adapter: String,
    identity: &str,
    admission: Admission,
) -> anyhow::Result<Config> {
    let loopback = arguments.listen.ip().is_loopback();
    let own = ["localhost", "127.0.0.1", "[::1]"].map(str::to_owned);
    let hosts = own.into_iter().chain([host_of(arguments.listen.ip())]).chain(arguments.allow_host.clone());
    // On the loopback a page may have any name that resolves to it; beyond, the machine's own name
    // and addresses of digits are no page's.
    let machine = if loopback { None } else { machine_name() };
    let hosts = AllowedHosts { names: hosts.chain(machine).collect(), addresses: !loopback };
    let is_known = loopback || !admission.is_open();
    let uploads = arguments.uploads == Uploads::On || (arguments.uploads == Uploads::Auto && is_known);
    let live = LiveConfig {
        sessions: arguments.sessions.into(),
        sensor: read_camera(arguments.sensor.as_deref())?,
        beacon: read_beacon(arguments.beacon.as_deref())?,
        ..LiveConfig::default()
    };
    Ok(Config {
        identity: format!("{} {identity}", build()),
        adapter,
        admission,
        requests_per_caller: (usize::from(arguments.queue) / 2).max(4),
        allowed_hosts: Some(hosts),
        uploads: uploads.then(UploadLimits::default),
        memory_bytes: arguments.memory,
        volume_names: match arguments.show_patient_data {
            true => NameSource::Description,
            false => NameSource::Anatomy,
        },
        content_bytes: arguments.contents,
        live,
        #[cfg(feature = "traces")]
        join_trace: arguments.traces.is_some().then_some(crate::traces::join),
        ..Config::default()
    })
}

/// Tells two builds of one version apart: a frame cached from the one is not a frame of the other.
/// By the program's content, so that servers of one build agree on every machine.
fn build() -> String {
    let digest = std::env::current_exe().and_then(|path| sha256_of_file(&path));
    // The start time identifies a program whose file cannot be read.
    let digits = digest
        .map_or_else(|_| format!("{:?}", std::time::SystemTime::now()), |digest| digest[..16].to_owned());
    format!("{}-{digits}", env!("CARGO_PKG_VERSION"))
}

/// An address that a browser on this machine can open.
fn reachable(address: SocketAddr) -> SocketAddr {
    let ip = match address.ip() {
        IpAddr::V4(ip) if ip.is_unspecified() => IpAddr::V4(std::net::Ipv4Addr::LOCALHOST),
        IpAddr::V6(ip) if ip.is_unspecified() => IpAddr::V6(std::net::Ipv6Addr::LOCALHOST),
        ip => ip,
    };
    SocketAddr::new(ip, address.port())
}

/// The machine's own name, where the system says it.
fn machine_name() -> Option<String> {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").ok()?;
    Some(name.trim().to_owned()).filter(|name| !name.is_empty())
}

/// An address as it stands in a `Host` header.
fn host_of(ip: IpAddr) -> String {
    match ip {
        IpAddr::V4(ip) => ip.to_string(),
        IpAddr::V6(ip) => format!("[{ip}]"),
    }
}
