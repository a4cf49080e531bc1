//! Messages between parent and child: a length of four bytes (little-endian) and JSON. Neither side
//! takes memory by an announced size: it grows as bytes arrive.

use std::io::{Error, ErrorKind, Read, Result, Write};

use serde::Serialize;
use serde::de::DeserializeOwned;

/// Largest JSON of a message: headers of hundreds of thousands of slices fit.
const MOST_JSON_BYTES: u32 = 256 << 20;

pub(crate) fn send(to: &mut impl Write, message: &impl Serialize) -> Result<()> {
    let json = serde_json::to_vec(message)?;
    let too_large = |_| Error::new(ErrorKind::InvalidData, "a message is too large");
    let length = u32::try_from(json.len()).map_err(too_large)?;
    to.write_all(&length.to_le_bytes())?;
    to.write_all(&json)
}

pub(crate) fn receive<T: DeserializeOwned>(from: &mut impl Read) -> Result<T> {
    let mut length = [0; 4];
    from.read_exact(&mut length)?;
    let length = u32::from_le_bytes(length);
    if length > MOST_JSON_BYTES {
        return Err(Error::new(ErrorKind::InvalidData, "a message is too large"));
    }
    let mut json = Vec::new();
    from.take(length.into()).read_to_end(&mut json)?;
    if json.len() < length as usize {
        return Err(ErrorKind::UnexpectedEof.into());
    }
    Ok(serde_json::from_slice(&json)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_come_through() {
        let mut bytes = Vec::new();
        send(&mut bytes, &"head").unwrap();
        let mut from = bytes.as_slice();
        assert_eq!(receive::<String>(&mut from).unwrap(), "head");
        assert!(receive::<String>(&mut from).is_err(), "the end is an error");
    }

    #[test]
    fn an_announced_size_allocates_nothing() {
        let mut short: &[u8] = &[255, 255, 255, 15, b'{'];
        assert!(receive::<String>(&mut short).is_err());
    }
}
