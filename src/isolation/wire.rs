//! Messages between parent and child: a length of four bytes (little-endian), JSON, and the bytes
//! that it announces. Neither side takes memory by an announced size: it grows as bytes arrive.

use std::io::{Error, ErrorKind, Read, Result, Write};

use serde::Serialize;
use serde::de::DeserializeOwned;

/// Largest JSON of a message: headers of hundreds of thousands of slices fit.
const MOST_JSON_BYTES: u32 = 256 << 20;
/// Bytes that are read at a time: few enough to stay in the cache of a core.
const CHUNK: usize = 256 << 10;

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

pub(crate) fn send_values<T: bytemuck::NoUninit>(to: &mut impl Write, values: &[T]) -> Result<()> {
    to.write_all(bytemuck::cast_slice(values))
}

/// Values as the machine has them: both sides are the same program. `count` is within the limits of
/// the caller: the whole range of addresses is reserved, and its pages are taken as bytes arrive.
///
/// # Errors
/// When the bytes end before, or there is no such range of addresses.
pub(crate) fn receive_values<T: bytemuck::Pod>(from: &mut impl Read, count: usize) -> Result<Vec<T>> {
    let mut values: Vec<T> = Vec::new();
    values.try_reserve_exact(count).map_err(|_| Error::from(ErrorKind::OutOfMemory))?;
    while values.len() < count {
        let before = values.len();
        values.resize(count.min(before + CHUNK / size_of::<T>()), T::zeroed());
        from.read_exact(bytemuck::cast_slice_mut(&mut values[before..]))?;
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn messages_and_values_come_through() {
        let mut bytes = Vec::new();
        send(&mut bytes, &"head").unwrap();
        let values: Vec<i16> = (0..(CHUNK as i32)).map(|value| value as i16).collect();
        send_values(&mut bytes, &values).unwrap();
        let mut from = bytes.as_slice();
        assert_eq!(receive::<String>(&mut from).unwrap(), "head");
        assert_eq!(receive_values::<i16>(&mut from, values.len()).unwrap(), values);
        assert!(receive::<String>(&mut from).is_err(), "the end is an error");
    }

    #[test]
    fn an_announced_size_allocates_nothing() {
        let mut short: &[u8] = &[255, 255, 255, 15, b'{'];
        assert!(receive::<String>(&mut short).is_err());
        let mut short: &[u8] = &[1, 2];
        assert!(receive_values::<i16>(&mut short, usize::MAX).is_err());
    }
}
