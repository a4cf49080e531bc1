//! Voxels of any numeric type, read in parts and converted.

use super::FormatError;
use super::bytes::Source;

/// How a number is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Number {
    U8,
    I8,
    U16,
    I16,
    U32,
    I32,
    U64,
    I64,
    F32,
    F64,
}

/// How a voxel is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Voxel {
    pub(super) number: Number,
    pub(super) is_big_endian: bool,
}

impl Number {
    pub(super) const fn bytes(self) -> usize {
        match self {
            Self::U8 | Self::I8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 | Self::I64 | Self::F64 => 8,
        }
    }
}

impl Voxel {
    /// The number in these bytes, of the length of its type. Integers beyond 2⁵³ are rounded.
    fn value(self, bytes: &[u8]) -> f64 {
        let mut eight = [0; 8];
        let count = bytes.len();
        for (i, byte) in bytes.iter().enumerate() {
            eight[if self.is_big_endian { count - 1 - i } else { i }] = *byte;
        }
        let [a, b, c, d, ..] = eight;
        match self.number {
            Number::U8 => f64::from(a),
            Number::I8 => f64::from(i8::from_le_bytes([a])),
            Number::U16 => f64::from(u16::from_le_bytes([a, b])),
            Number::I16 => f64::from(i16::from_le_bytes([a, b])),
            Number::U32 => f64::from(u32::from_le_bytes([a, b, c, d])),
            Number::I32 => f64::from(i32::from_le_bytes([a, b, c, d])),
            Number::F32 => f64::from(f32::from_le_bytes([a, b, c, d])),
            Number::U64 => u64::from_le_bytes(eight) as f64,
            Number::I64 => i64::from_le_bytes(eight) as f64,
            Number::F64 => f64::from_le_bytes(eight),
        }
    }
}

/// Bytes that are read at a time.
const PART: usize = 1 << 18;

/// Reads a number of voxels, each through `convert`, which returns a value that it refuses.
///
/// The list grows with the bytes that are read.
///
/// # Errors
/// When the file ends before, a value is refused, or memory is short.
pub(super) fn read<T>(
    source: &mut Source,
    voxel: Voxel,
    count: usize,
    mut convert: impl FnMut(f64) -> Result<T, f64>,
) -> Result<Vec<T>, FormatError> {
    let size = voxel.number.bytes();
    let mut values = Vec::new();
    let mut part = vec![0; PART];
    while values.len() < count {
        let wanted = ((count - values.len()) * size).min(PART);
        let found = source.fill(&mut part[..wanted])?;
        if found < wanted {
            let found = (values.len() * size + found) as u64;
            return Err(FormatError::Cut { expected: count as u64 * size as u64, found });
        }
        values.try_reserve(wanted / size).map_err(|_| FormatError::Memory(count as u64))?;
        for bytes in part[..wanted].chunks_exact(size) {
            let value = convert(voxel.value(bytes)).map_err(|found| {
                let index = values.len() as u64;
                FormatError::Value { index, found, allowed: "a finite number within the format's range" }
            })?;
            values.push(value);
        }
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_of_every_type_and_byte_order_are_read() {
        use Number::{F32, F64, I8, I16, I32, I64, U8, U16, U32, U64};
        for (number, little, expected) in [
            (U8, vec![200], 200.0),
            (I8, vec![200], -56.0),
            (U16, 60_000u16.to_le_bytes().to_vec(), 60_000.0),
            (I16, (-1024i16).to_le_bytes().to_vec(), -1024.0),
            (U32, 4_000_000_000u32.to_le_bytes().to_vec(), 4e9),
            (I32, (-7i32).to_le_bytes().to_vec(), -7.0),
            (U64, (1u64 << 40).to_le_bytes().to_vec(), 2f64.powi(40)),
            (I64, (-9i64).to_le_bytes().to_vec(), -9.0),
            (F32, 0.5f32.to_le_bytes().to_vec(), 0.5),
            (F64, (-2.25f64).to_le_bytes().to_vec(), -2.25),
        ] {
            for is_big_endian in [false, true] {
                let mut bytes = little.clone();
                if is_big_endian {
                    bytes.reverse();
                }
                let bytes = bytes.repeat(3);
                let mut source = Source::of_bytes(&bytes).unwrap();
                let voxel = Voxel { number, is_big_endian };
                assert_eq!(read(&mut source, voxel, 3, Ok).unwrap(), [expected; 3], "{voxel:?}");
                assert!(matches!(read(&mut source, voxel, 1, Ok), Err(FormatError::Cut { found: 0, .. })));
            }
        }
    }
}
