//! The author of a request: the header `Relief-Author`, percent-encoded UTF-8 (RFC 3986), because
//! headers are ASCII. Where callers have to be known, the server itself sets it to the caller's
//! name.

use std::fmt::Write;

use axum::http::{HeaderMap, HeaderName, HeaderValue, StatusCode};
use serde_json::Value;

use crate::problem::Problem;
use relief_annotation::Item;

static RELIEF_AUTHOR: HeaderName = HeaderName::from_static("relief-author");

/// The author that a request names; `None` where it names none.
///
/// # Errors
/// When the header is no percent-encoded UTF-8, or no name.
pub(crate) fn author_of(headers: &HeaderMap) -> Result<Option<String>, Problem> {
    let Some(value) = headers.get(&RELIEF_AUTHOR) else { return Ok(None) };
    let author = value.to_str().ok().and_then(decoded).ok_or_else(|| {
        let detail = "the header Relief-Author is no percent-encoded UTF-8, such as Ren%C3%A9e";
        Problem::new(StatusCode::BAD_REQUEST, "malformed-author", detail).with("path", "Relief-Author")
    })?;
    check(&author)?;
    Ok(Some(author))
}

/// The author that a JSON body names; `None` where it names none, or null.
///
/// # Errors
/// When it is no text.
pub(super) fn of_body(author: Option<&Value>) -> Result<Option<String>, Problem> {
    match author {
        None | Some(Value::Null) => Ok(None),
        Some(Value::String(author)) => Ok(Some(author.clone())),
        Some(other) => {
            let detail = format!("author is {other}, allowed: a text");
            Err(Problem::new(StatusCode::BAD_REQUEST, "malformed-author", detail).with("path", "author"))
        }
    }
}

/// Sets the author of a request.
pub(crate) fn set_author(headers: &mut HeaderMap, author: &str) {
    let encoded = author.bytes().fold(String::new(), |mut text, byte| {
        let _ = match byte {
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' => write!(text, "{}", char::from(byte)),
            _ => write!(text, "%{byte:02X}"),
        };
        text
    });
    if let Ok(value) = HeaderValue::from_str(&encoded) {
        headers.insert(&RELIEF_AUTHOR, value);
    }
}

/// Checks a name: one line of 1 to 120 characters.
pub(crate) fn check(author: &str) -> Result<(), Problem> {
    let characters = author.chars().count();
    if (1..=Item::LONGEST_NAME).contains(&characters) && !author.contains(char::is_control) {
        return Ok(());
    }
    let detail =
        format!("an author of {characters} characters, allowed: 1 to {} in one line", Item::LONGEST_NAME);
    Err(Problem::new(StatusCode::BAD_REQUEST, "malformed-author", detail).with("path", "author"))
}

pub(crate) fn missing() -> Problem {
    let detail = "every change has an author; name one in the header Relief-Author (percent-encoded), or as author in the body";
    Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "no-author", detail).with("path", "author")
}

/// A percent-encoded text; `None` when its encoding is wrong, or not UTF-8.
pub(crate) fn decoded(text: &str) -> Option<String> {
    let mut bytes = Vec::with_capacity(text.len());
    let mut rest = text.as_bytes();
    while let [first, tail @ ..] = rest {
        rest = if *first == b'%' {
            let digits = std::str::from_utf8(tail.get(..2)?).ok()?;
            let is_hex = digits.bytes().all(|digit| digit.is_ascii_hexdigit());
            bytes.push(u8::from_str_radix(digits, 16).ok().filter(|_| is_hex)?);
            &tail[2..]
        } else {
            bytes.push(*first);
            tail
        };
    }
    String::from_utf8(bytes).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_come_through_percent_encoding() {
        let of =
            |value: &str| author_of(&HeaderMap::from_iter([(RELIEF_AUTHOR.clone(), value.parse().unwrap())]));
        assert_eq!(author_of(&HeaderMap::new()).unwrap(), None);
        for (value, name) in [("anna", "anna"), ("Ren%C3%A9e%20B", "Renée B"), ("a%25", "a%")] {
            assert_eq!(of(value).unwrap().as_deref(), Some(name));
        }
        let mut headers = HeaderMap::new();
        set_author(&mut headers, "Renée B%");
        assert_eq!(author_of(&headers).unwrap().as_deref(), Some("Renée B%"));
        for bad in ["%", "%4", "%zz", "%+1", "%ff", "", "a%0Ab", &"a".repeat(121)] {
            assert!(of(bad).is_err(), "{bad}");
        }
    }
}
