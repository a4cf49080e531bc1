//! Addresses of archives, studies, series and queries, as options and manifests have them.

use std::fmt;
use std::str::FromStr;

use url::Url;

/// The prefix that distinguishes the address of an archive from a path.
pub const SCHEME: &str = "dicomweb+";
/// Longest UID, characters (PS3.5).
const LONGEST_UID: usize = 64;

/// The address of an archive, of a study or a series in it, or of the series that match a query.
#[derive(Clone, PartialEq, Eq)]
pub struct ArchiveAddress {
    /// The root of its services, such as `https://HOST/dicom-web`, without a slash at its end.
    base: String,
    study: Option<String>,
    series: Option<String>,
    /// Attributes and the values that they must have.
    query: Vec<(String, String)>,
}

/// Why a text is not the address of an archive. No message has the text: it may name a patient.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum AddressError {
    /// It does not begin with the scheme, or the rest is not a URL of HTTP.
    #[error(
        "not the address of an archive; write dicomweb+https://HOST/ROOT, followed by /studies/UID, /studies/UID/series/UID or ?ATTRIBUTE=VALUE if wanted"
    )]
    Url,
    /// It has a user or a password, which lists of processes and logs would show.
    #[error("an address must not have a user or a password; give --archive-login-file")]
    Credentials,
    /// Something else than a UID is in the place of one.
    #[error("the address has a study or a series that is not a UID: up to 64 digits and dots")]
    Uid,
    /// It goes on behind the series.
    #[error("the address must end with the study or the series; single instances and frames are not loaded")]
    Instance,
    /// A parameter has no value.
    #[error("the query of the address has a parameter without a value; write ?ATTRIBUTE=VALUE")]
    Parameter,
}

impl ArchiveAddress {
    /// The root of the archive's services.
    #[must_use]
    pub fn base(&self) -> &str {
        &self.base
    }

    /// The UID of the study, if the address has one.
    #[must_use]
    pub fn study(&self) -> Option<&str> {
        self.study.as_deref()
    }

    /// The UID of the series, if the address has one.
    #[must_use]
    pub fn series(&self) -> Option<&str> {
        self.series.as_deref()
    }

    /// The attributes that matches must have, as DICOM keywords or tags, with their values.
    #[must_use]
    pub fn query(&self) -> &[(String, String)] {
        &self.query
    }

    /// The address of one series of the same archive.
    ///
    /// # Errors
    /// When one of them is not a UID.
    pub fn of_series(&self, study: &str, series: &str) -> Result<Self, AddressError> {
        let [study, series] = [uid(study)?, uid(series)?];
        Ok(Self { base: self.base.clone(), study: Some(study), series: Some(series), query: Vec::new() })
    }

    /// The address of the series of the same archive, study and series that match a query: DICOM
    /// keywords or tags, with values.
    #[must_use]
    pub fn matching<'a>(&self, query: impl IntoIterator<Item = (&'a str, &'a str)>) -> Self {
        let query = query.into_iter().map(|(name, value)| (name.to_owned(), value.to_owned()));
        Self { query: query.collect(), ..self.clone() }
    }

    /// Whether `other` is in the same archive, and in the same study and series if this address names
    /// them. An address with a query contains no other, because only the archive knows its matches.
    #[must_use]
    pub fn contains(&self, other: &Self) -> bool {
        let is_in = |own: &Option<String>, other: &Option<String>| own.is_none() || own == other;
        self.query.is_empty()
            && self.base == other.base
            && is_in(&self.study, &other.study)
            && is_in(&self.series, &other.series)
    }

    /// The name for logs and messages: the archive alone.
    #[must_use]
    pub fn public_name(&self) -> String {
        let part = match (&self.study, &self.series) {
            (_, Some(_)) => "a series of ",
            (Some(_), None) => "a study of ",
            (None, None) => "",
        };
        format!("{part}{SCHEME}{}", self.base)
    }
}

impl FromStr for ArchiveAddress {
    type Err = AddressError;

    fn from_str(text: &str) -> Result<Self, AddressError> {
        let url = text.strip_prefix(SCHEME).and_then(|url| Url::parse(url).ok()).ok_or(AddressError::Url)?;
        if !matches!(url.scheme(), "http" | "https") || url.host_str().is_none() || url.fragment().is_some() {
            return Err(AddressError::Url);
        }
        if !url.username().is_empty() || url.password().is_some() {
            return Err(AddressError::Credentials);
        }
        let (root, wanted) = split(url.path())?;
        let query = url.query_pairs().map(|(name, value)| (name.into_owned(), value.into_owned()));
        let query: Vec<(String, String)> = query.collect();
        if query.iter().any(|(name, value)| name.is_empty() || value.is_empty()) {
            return Err(AddressError::Parameter);
        }
        let base = format!("{}{root}", url.origin().ascii_serialization());
        let [study, series] = wanted;
        Ok(Self { base, study, series, query })
    }
}

/// The root of the services, and the UIDs of study and series.
fn split(path: &str) -> Result<(String, [Option<String>; 2]), AddressError> {
    let parts: Vec<&str> = path.split('/').filter(|part| !part.is_empty()).collect();
    let root = parts.iter().position(|part| matches!(*part, "studies" | "series")).unwrap_or(parts.len());
    let wanted = match &parts[root..] {
        [] | ["studies"] | ["series"] => [None, None],
        ["studies", study] | ["studies", study, "series"] => [Some(uid(study)?), None],
        ["studies", study, "series", series] => [Some(uid(study)?), Some(uid(series)?)],
        ["studies", ..] => return Err(AddressError::Instance),
        _ => return Err(AddressError::Url),
    };
    let root = parts[..root].iter().fold(String::new(), |root, part| root + "/" + part);
    Ok((root, wanted))
}

fn uid(text: &str) -> Result<String, AddressError> {
    let is_uid = (1..=LONGEST_UID).contains(&text.len())
        && text.bytes().all(|letter| letter.is_ascii_digit() || letter == b'.');
    is_uid.then(|| text.to_owned()).ok_or(AddressError::Uid)
}

/// The address, which may have UIDs: for manifests, not for messages.
impl fmt::Display for ArchiveAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{SCHEME}{}", self.base)?;
        if let Some(study) = &self.study {
            write!(f, "/studies/{study}")?;
        }
        if let Some(series) = &self.series {
            write!(f, "/series/{series}")?;
        }
        if self.query.is_empty() {
            return Ok(());
        }
        let mut query = Url::parse("http://query/").map_err(|_| fmt::Error)?;
        query.query_pairs_mut().extend_pairs(&self.query);
        write!(f, "?{}", query.query().unwrap_or_default())
    }
}

impl fmt::Debug for ArchiveAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("ArchiveAddress").field(&self.public_name()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parsed(text: &str) -> Result<ArchiveAddress, AddressError> {
        text.parse()
    }

    #[test]
    fn an_address_has_an_archive_and_what_is_wanted_of_it() {
        for (text, base, study, series) in [
            ("dicomweb+https://ct/dicom-web/", "https://ct/dicom-web", None, None),
            ("dicomweb+http://ct:8042/a/b/studies", "http://ct:8042/a/b", None, None),
            ("dicomweb+https://ct/studies/1.2", "https://ct", Some("1.2"), None),
            ("dicomweb+https://ct/rs/studies/1.2/series", "https://ct/rs", Some("1.2"), None),
            ("dicomweb+https://ct/rs/studies/1.2/series/3.4", "https://ct/rs", Some("1.2"), Some("3.4")),
        ] {
            let address = parsed(text).unwrap();
            assert_eq!((address.base(), address.study(), address.series()), (base, study, series), "{text}");
            assert_eq!(parsed(&address.to_string()), Ok(address), "{text}");
        }
    }

    #[test]
    fn a_query_survives_being_written() {
        let address = parsed("dicomweb+https://ct/rs/series?PatientName=a%20b*&Modality=CT").unwrap();
        let expected = [("PatientName", "a b*"), ("Modality", "CT")];
        assert_eq!(address.query(), expected.map(|(name, value)| (name.to_owned(), value.to_owned())));
        assert_eq!(parsed(&address.to_string()), Ok(address));
    }

    #[test]
    fn messages_and_debugging_show_no_uid_and_no_query() {
        let address = parsed("dicomweb+https://ct/rs/studies/1.2.77/series/3.4.77").unwrap();
        let query = parsed("dicomweb+https://ct/rs?PatientID=77").unwrap();
        for address in [address, query] {
            assert!(!address.public_name().contains("77") && !format!("{address:?}").contains("77"));
        }
    }

    #[test]
    fn what_cannot_be_loaded_is_refused() {
        for (text, error) in [
            ("https://ct/rs", AddressError::Url),
            ("dicomweb+ftp://ct/rs", AddressError::Url),
            ("dicomweb+https://ct/rs#a", AddressError::Url),
            ("dicomweb+https://ct/rs/series/1.2", AddressError::Url),
            ("dicomweb+https://user:key@ct/rs", AddressError::Credentials),
            ("dicomweb+https://ct/rs/studies/..%2f", AddressError::Uid),
            ("dicomweb+https://ct/rs/studies/1/series/2/instances/3", AddressError::Instance),
            ("dicomweb+https://ct/rs?PatientID", AddressError::Parameter),
        ] {
            assert_eq!(parsed(text), Err(error), "{text}");
        }
    }

    #[test]
    fn an_archive_contains_its_series() {
        let [all, study, series, other, query] = [
            "dicomweb+https://ct/rs",
            "dicomweb+https://ct/rs/studies/1",
            "dicomweb+https://ct/rs/studies/1/series/2",
            "dicomweb+https://ct/rsx/studies/1",
            "dicomweb+https://ct/rs?PatientID=1",
        ]
        .map(|text| parsed(text).unwrap());
        assert!(all.contains(&series) && study.contains(&series) && series.contains(&series));
        assert!(!series.contains(&study) && !all.contains(&other) && !query.contains(&series));
    }
}
