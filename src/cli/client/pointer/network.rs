//! Addresses of trackers on a network.

use relief_tracking::VRPN_PORT;

/// A tool of a server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Network {
    /// Its host and port.
    pub(super) address: String,
    /// The name of the tool's device there; any where left out.
    pub(super) device: Option<String>,
    /// Number of the device's sensor.
    pub(super) sensor: i32,
}

/// `HOST:PORT[/DEVICE]`
pub(super) fn igtl_source(text: &str) -> Option<Network> {
    let (address, device) =
        text.split_once('/').map_or((text, None), |(address, device)| (address, Some(device)));
    let is_meant = has_port(address) && device != Some("");
    is_meant.then(|| Network { address: address.to_owned(), device: device.map(str::to_owned), sensor: 0 })
}

/// `DEVICE@HOST[:PORT][/SENSOR]`
pub(super) fn vrpn_source(text: &str) -> Option<Network> {
    let (device, server) = text.rsplit_once('@').filter(|(device, _)| !device.is_empty())?;
    let (address, sensor) = server.split_once('/').map_or((server, "0"), |parts| parts);
    let sensor = sensor.parse().ok().filter(|sensor| *sensor >= 0)?;
    let address = if has_port(address) { address.to_owned() } else { format!("{address}:{VRPN_PORT}") };
    let is_host = has_port(&address) && (address.starts_with('[') || address.matches(':').count() == 1);
    is_host.then(|| Network { address, device: Some(device.to_owned()), sensor })
}

fn has_port(address: &str) -> bool {
    address.rsplit_once(':').is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok())
}
