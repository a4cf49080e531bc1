//! Addresses of trackers on a network.

/// A tool of a server.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Network {
    /// Its host and port.
    pub(super) address: String,
    /// The name of the tool's device there; any where left out.
    pub(super) device: Option<String>,
}

/// `HOST:PORT[/DEVICE]`
pub(super) fn igtl_source(text: &str) -> Option<Network> {
    let (address, device) =
        text.split_once('/').map_or((text, None), |(address, device)| (address, Some(device)));
    let is_meant = has_port(address) && device != Some("");
    is_meant.then(|| Network { address: address.to_owned(), device: device.map(str::to_owned) })
}

fn has_port(address: &str) -> bool {
    address.rsplit_once(':').is_some_and(|(host, port)| !host.is_empty() && port.parse::<u16>().is_ok())
}
