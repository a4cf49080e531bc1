//! The demands of a request's headers on the answer: the media type, and whether the client has it
//! already.
//!
//! RFC 9110, 12.5.1: each offer gets the weight of the most specific range that matches it; the
//! largest weight wins, and among equals the server's order. Parameters of media types other than
//! `q` are ignored.

use axum::http::{HeaderMap, HeaderName, StatusCode, header};
use serde_json::Value;

use super::problem::Problem;
use relief_session::FileFormat;

/// The offer that the client likes best; the first one when it says nothing.
///
/// # Errors
/// 406 with the list when it takes none of them.
pub(super) fn negotiate(headers: &HeaderMap, offers: &[FileFormat]) -> Result<FileFormat, Problem> {
    let values: Vec<_> =
        headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok()).collect();
    let accept = values.join(",");
    if accept.trim().is_empty() {
        return Ok(offers[0]);
    }
    let ranges: Vec<Range> = accept.split(',').filter_map(Range::parse).collect();
    let weighed = offers.iter().map(|&offer| (offer, weight(&ranges, offer.media_type())));
    // `max_by` keeps the last of equals; the offers are in order of preference.
    let best = weighed.rev().max_by(|(_, a), (_, b)| a.total_cmp(b)).filter(|(_, weight)| *weight > 0.0);
    best.map(|(media, _)| media).ok_or_else(|| {
        let names: Vec<&str> = offers.iter().map(|media| media.media_type()).collect();
        let detail = format!("Accept allows no media type of this answer; they are: {}", names.join(", "));
        Problem::new(StatusCode::NOT_ACCEPTABLE, "not-acceptable", detail).with("offers", Value::from(names))
    })
}

/// Whether an `Accept` header allows this media type.
pub(super) fn accepts(headers: &HeaderMap, media_type: &str) -> bool {
    let values = headers.get_all(header::ACCEPT).iter().filter_map(|value| value.to_str().ok());
    let ranges: Vec<Range> = values.flat_map(|value| value.split(',')).filter_map(Range::parse).collect();
    !headers.contains_key(header::ACCEPT) || weight(&ranges, media_type) > 0.0
}

/// Whether `If-None-Match` names this tag, or `*`, by the weak comparison (RFC 9110, 13.1.2). Tags
/// hold no commas.
pub(super) fn knows_tag(headers: &HeaderMap, tag: &str) -> bool {
    let values = headers.get_all(header::IF_NONE_MATCH).iter().filter_map(|value| value.to_str().ok());
    let opaque = tag.trim_start_matches("W/");
    let mut known = values.flat_map(|value| value.split(',')).map(str::trim);
    known.any(|known| known == "*" || known.trim_start_matches("W/") == opaque)
}

/// A strong entity tag of a text.
pub(super) fn text_tag(text: &str) -> String {
    format!("\"{}\"", &relief_base::sha256_of(text.as_bytes())[..24])
}

/// Whether `If-Match` and `If-None-Match` allow a text to be replaced; `current` is absent where
/// there is none yet. Without these headers everything may be replaced (RFC 9110, 13.1).
pub(super) fn may_replace(headers: &HeaderMap, current: Option<&str>) -> bool {
    let tag = current.map(text_tag);
    let named = |name: HeaderName| -> Option<bool> {
        let values = headers.get_all(&name).iter().filter_map(|value| value.to_str().ok());
        let mut named = values.flat_map(|value| value.split(',')).map(str::trim).peekable();
        named.peek()?;
        Some(named.any(|named| tag.as_deref().is_some_and(|tag| named == "*" || named == tag)))
    };
    named(header::IF_MATCH).unwrap_or(true) && !named(header::IF_NONE_MATCH).unwrap_or(false)
}

/// One media range of an Accept header.
struct Range<'a> {
    kind: &'a str,
    subtype: &'a str,
    weight: f32,
}

impl<'a> Range<'a> {
    fn parse(text: &'a str) -> Option<Self> {
        let mut parts = text.split(';');
        let (kind, subtype) = parts.next()?.trim().split_once('/')?;
        let q = parts.find_map(|part| part.trim().strip_prefix("q=").or(part.trim().strip_prefix("Q=")));
        let weight = q.map_or(Some(1.0), |q| q.trim().parse().ok())?;
        (0.0..=1.0).contains(&weight).then_some(Self { kind, subtype, weight })
    }

    /// How closely this range names a media type: 0 for `*/*`, 2 for the very type; `None` if it is
    /// another.
    fn specificity(&self, kind: &str, subtype: &str) -> Option<u8> {
        match (self.kind, self.subtype) {
            ("*", "*") => Some(0),
            (own, "*") if own.eq_ignore_ascii_case(kind) => Some(1),
            (own, sub) if own.eq_ignore_ascii_case(kind) && sub.eq_ignore_ascii_case(subtype) => Some(2),
            _ => None,
        }
    }
}

fn weight(ranges: &[Range<'_>], media: &str) -> f32 {
    let (kind, subtype) = media.split_once('/').unwrap_or((media, ""));
    let matching = ranges.iter().filter_map(|range| Some((range.specificity(kind, subtype)?, range.weight)));
    matching.max_by_key(|(specificity, _)| *specificity).map_or(0.0, |(_, weight)| weight)
}

#[cfg(test)]
mod tests {
    use super::*;

    const OFFERS: [FileFormat; 4] = [FileFormat::Png, FileFormat::Jpeg, FileFormat::Exr, FileFormat::Raw];

    fn choice(accept: &str) -> Option<FileFormat> {
        let headers = HeaderMap::from_iter([(header::ACCEPT, accept.parse().unwrap())]);
        negotiate(&headers, &OFFERS).ok()
    }

    #[test]
    fn weights_and_specificity_decide_and_the_offers_order_breaks_ties() {
        for (accept, media) in [
            ("*/*", Some(FileFormat::Png)),
            ("", Some(FileFormat::Png)),
            ("image/*", Some(FileFormat::Png)),
            ("image/jpeg", Some(FileFormat::Jpeg)),
            ("IMAGE/JPEG", Some(FileFormat::Jpeg)),
            ("image/avif,image/webp,image/png,image/svg+xml,image/*;q=0.8,*/*;q=0.5", Some(FileFormat::Png)),
            ("image/png;q=0.5, image/x-exr", Some(FileFormat::Exr)),
            ("image/png;q=0.2, image/jpeg;q=0.7, */*;q=0.1", Some(FileFormat::Jpeg)),
            ("image/png;q=0, */*", Some(FileFormat::Jpeg)),
            ("image/*;q=0.3, application/octet-stream;q=0.4", Some(FileFormat::Raw)),
            ("text/html", None),
            ("image/png;q=0", None),
            ("image/png;q=7", None),
            ("nonsense", None),
        ] {
            assert_eq!(choice(accept), media, "{accept:?}");
        }
    }

    #[test]
    fn tags_compare_weakly_in_lists_and_lines() {
        for (values, tag, known) in [
            (&[r#""a""#][..], r#""a""#, true),
            (&[r#"W/"a""#], r#""a""#, true),
            (&[r#""a""#], r#"W/"a""#, true),
            (&[r#""b" , W/"a""#], r#""a""#, true),
            (&[r#""b""#, r#""a""#], r#""a""#, true),
            (&["*"], r#""a""#, true),
            (&["a"], r#""a""#, false),
            (&[r#""ab""#], r#""a""#, false),
            (&[], r#""a""#, false),
        ] {
            let line = |value: &&str| (header::IF_NONE_MATCH, value.parse().unwrap());
            assert_eq!(knows_tag(&values.iter().map(line).collect(), tag), known, "{values:?} {tag}");
        }
    }

    #[test]
    fn no_header_takes_the_first_offer() {
        assert_eq!(negotiate(&HeaderMap::new(), &OFFERS[1..]).unwrap(), FileFormat::Jpeg);
    }
}
