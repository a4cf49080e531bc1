//! A client of one archive: requests that are tried again, and answers of bounded size.

use std::time::Duration;

use bytes::Bytes;
use reqwest::header::{ACCEPT, CONTENT_TYPE};
use reqwest::{Client, Response, StatusCode, Url};
use tokio::runtime::Runtime;

use crate::access::ArchiveAccess;
use crate::address::ArchiveAddress;
use crate::error::ArchiveError;

/// The longest time until a connection is made.
const CONNECT: Duration = Duration::from_secs(10);
/// The longest pause of an archive within an answer.
const PAUSE: Duration = Duration::from_secs(60);
/// Tries of a request; the pauses between them double.
const TRIES: u32 = 5;
const FIRST_PAUSE: Duration = Duration::from_millis(200);

/// A client of one archive. Its methods wait for answers: they must not be called inside an
/// executor.
#[derive(Debug)]
pub struct Archive {
    pub(crate) base: String,
    client: Client,
    pub(crate) runtime: Runtime,
}

impl Archive {
    /// Prepares connections to the archive of an address. Nothing is sent yet.
    ///
    /// # Errors
    /// When the files of the access cannot be used.
    pub fn open(address: &ArchiveAddress, access: &ArchiveAccess) -> Result<Self, ArchiveError> {
        // Redirects may lead secrets and requests elsewhere: none is followed.
        let builder = Client::builder()
            .connect_timeout(CONNECT)
            .read_timeout(PAUSE)
            .redirect(reqwest::redirect::Policy::none())
            .user_agent(concat!("relief/", env!("CARGO_PKG_VERSION")));
        let client = access.client(builder)?;
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build()?;
        let archive = Self { base: address.base().to_owned(), client, runtime };
        if access.credentials.is_some() && archive.is_open_to_others() {
            tracing::warn!(
                "the address of the archive is http: others in the network can read the password or token"
            );
        }
        Ok(archive)
    }

    /// Whether requests travel beyond this machine without encryption.
    fn is_open_to_others(&self) -> bool {
        let Ok(url) = Url::parse(&self.base) else { return false };
        let host = url.host_str().unwrap_or_default().trim_matches(['[', ']']);
        let is_near =
            host == "localhost" || host.parse::<std::net::IpAddr>().is_ok_and(|ip| ip.is_loopback());
        url.scheme() == "http" && !is_near
    }

    /// Makes a request until it succeeds, or is known to fail again.
    pub(crate) async fn tried<T>(
        &self,
        mut request: impl AsyncFnMut() -> Result<T, ArchiveError>,
    ) -> Result<T, ArchiveError> {
        for number in 0..TRIES - 1 {
            match request().await {
                Err(error) if error.is_passing() => {
                    tracing::debug!("try {} of {TRIES} failed: {error}", number + 1);
                    tokio::time::sleep(FIRST_PAUSE * 2_u32.pow(number)).await;
                }
                outcome => return outcome,
            }
        }
        request().await
    }

    /// Limits the total time of several requests. At the limit the current request is cancelled.
    pub(crate) async fn within<T>(
        &self,
        longest: Duration,
        requests: impl Future<Output = Result<T, ArchiveError>>,
    ) -> Result<T, ArchiveError> {
        tokio::time::timeout(longest, requests).await.map_err(|_| self.too_slow(longest))?
    }

    pub(crate) fn too_slow(&self, longest: Duration) -> ArchiveError {
        ArchiveError::TooSlow { archive: self.base.clone(), longest }
    }

    /// Requests a resource below the root; the head of a successful answer.
    pub(crate) async fn get(
        &self,
        path: &str,
        query: &[(&str, &str)],
        accepted: &str,
        wanted: &'static str,
    ) -> Result<Response, ArchiveError> {
        let mut url = Url::parse(&format!("{}{path}", self.base))
            .map_err(|_| self.answer("an unusable address", "a URL"))?;
        if !query.is_empty() {
            url.query_pairs_mut().extend_pairs(query);
            // Forms write a space as +, which is a plus in other addresses (RFC 3986).
            let encoded = url.query().map(|query| query.replace('+', "%20"));
            url.set_query(encoded.as_deref());
        }
        let request = self.client.get(url).header(ACCEPT, accepted);
        self.successful(request.send().await.map_err(|error| self.unreachable(error))?, wanted)
    }

    /// Sends a body to a resource below the root; the answer, whatever its status.
    pub(crate) async fn post(
        &self,
        path: &str,
        kind: &str,
        accepted: &str,
        body: Bytes,
    ) -> Result<Response, ArchiveError> {
        let request = self.client.post(format!("{}{path}", self.base));
        let request = request.header(ACCEPT, accepted).header(CONTENT_TYPE, kind).body(body);
        request.send().await.map_err(|error| self.unreachable(error))
    }

    pub(crate) fn successful(
        &self,
        response: Response,
        wanted: &'static str,
    ) -> Result<Response, ArchiveError> {
        let (archive, status) = (self.base.clone(), response.status());
        match status {
            StatusCode::UNAUTHORIZED | StatusCode::FORBIDDEN => {
                Err(ArchiveError::Refused { archive, status: status.as_u16() })
            }
            StatusCode::NOT_FOUND | StatusCode::GONE => Err(ArchiveError::Missing { archive, wanted }),
            status if status.is_success() => Ok(response),
            status => Err(ArchiveError::Status { archive, status: status.as_u16() }),
        }
    }

    /// The body of an answer, if it has at most `allowed` bytes.
    pub(crate) async fn body(&self, mut response: Response, allowed: u64) -> Result<Vec<u8>, ArchiveError> {
        let mut body = Vec::new();
        while let Some(chunk) = self.chunk(&mut response).await? {
            if (body.len() + chunk.len()) as u64 > allowed {
                return Err(self.too_large(allowed, "bytes"));
            }
            body.extend_from_slice(&chunk);
        }
        Ok(body)
    }

    /// The next bytes of an answer.
    pub(crate) async fn chunk(&self, response: &mut Response) -> Result<Option<Bytes>, ArchiveError> {
        response.chunk().await.map_err(|error| self.unreachable(error))
    }

    pub(crate) fn too_large(&self, allowed: u64, unit: &'static str) -> ArchiveError {
        ArchiveError::TooLarge { archive: self.base.clone(), allowed, unit }
    }

    pub(crate) fn answer(&self, found: &'static str, expected: &'static str) -> ArchiveError {
        ArchiveError::Answer { archive: self.base.clone(), found, expected }
    }

    pub(crate) fn missing(&self, wanted: &'static str) -> ArchiveError {
        ArchiveError::Missing { archive: self.base.clone(), wanted }
    }

    /// The address of the request may have UIDs.
    pub(crate) fn unreachable(&self, error: reqwest::Error) -> ArchiveError {
        ArchiveError::Unreachable { archive: self.base.clone(), source: error.without_url() }
    }
}
