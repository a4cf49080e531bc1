//! JPEG's entropy-coded data: Huffman codes and the bits they are read from (ITU-T T.81 annexes C
//! and F).

use std::fmt;

/// A fault of a codestream of discrete cosine transforms.
#[derive(Debug, thiserror::Error)]
pub(super) enum JpegFault {
    #[error("found {0} bits per sample, expected at most 12")]
    Precision(u32),
    #[error("found more than {0} scans")]
    TooManyScans(usize),
    #[error("found no scan")]
    NoScan,
    #[error("found a scan of {0} components, expected 1")]
    Components(u8),
    #[error("found a scan of coefficients {first} to {last}, bit {low}")]
    Coefficients { first: usize, last: usize, low: u8 },
    #[error("found table {0}, expected 0 to 3")]
    Table(u8),
    #[error("{0} is cut short")]
    CutShort(Part),
    #[error("the Huffman table has too many codes")]
    TooManyCodes,
    #[error("a Huffman table is missing")]
    NoHuffmanTable,
    #[error("found bits that no Huffman code begins with")]
    NoCode,
    #[error("found a coefficient of {0} bits, expected at most 16")]
    CoefficientBits(u8),
    #[error("a run of zeros leaves the block")]
    Run,
    #[error("found no restart marker where one is expected")]
    NoRestart,
}

/// A part of a codestream.
#[derive(Clone, Copy, Debug)]
pub(super) enum Part {
    HuffmanTable,
    QuantizationTable,
    RestartInterval,
    EntropyCodedData,
}

impl fmt::Display for Part {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::HuffmanTable => "the Huffman table",
            Self::QuantizationTable => "the quantization table",
            Self::RestartInterval => "the restart interval",
            Self::EntropyCodedData => "the entropy-coded segment",
        })
    }
}

/// A Huffman code as a table over the next 16 bits: symbol and length (0 where no code begins so).
#[derive(Default)]
pub(super) struct Huffman {
    lookup: Vec<(u8, u8)>,
}

impl Huffman {
    /// The canonical code with `counts[n]` codes of n + 1 bits (T.81 annex C).
    pub(super) fn new(counts: &[u8], symbols: &[u8]) -> Result<Self, JpegFault> {
        let mut lookup = vec![(0, 0); 1 << 16];
        let lengths =
            (1u8..).zip(counts).flat_map(|(length, &count)| std::iter::repeat_n(length, count.into()));
        let mut next = 0usize;
        for (length, &symbol) in lengths.zip(symbols) {
            let span = 1usize << (16 - length);
            let entries = lookup.get_mut(next..next + span).ok_or(JpegFault::TooManyCodes)?;
            entries.fill((symbol, length));
            next += span;
        }
        Ok(Self { lookup })
    }
}

/// Entropy-coded bits, most significant first; FF 00 stands for FF (T.81 B.1.1.5).
pub(super) struct Bits<'a> {
    data: &'a [u8],
    position: usize,
    buffer: u32,
    /// Bits in the buffer, from its top.
    count: u32,
}

impl<'a> Bits<'a> {
    pub(super) fn new(data: &'a [u8]) -> Self {
        Self { data, position: 0, buffer: 0, count: 0 }
    }

    /// Fills the buffer as far as there are bytes before the next marker.
    fn fill(&mut self) {
        while self.count <= 24 {
            let byte = match self.data.get(self.position..) {
                Some([0xFF, 0x00, ..]) => {
                    self.position += 1;
                    0xFF
                }
                Some([0xFF, ..] | []) | None => return,
                Some([byte, ..]) => *byte,
            };
            self.position += 1;
            self.buffer |= u32::from(byte) << (24 - self.count);
            self.count += 8;
        }
    }

    /// The next `count` bits, at most 16.
    pub(super) fn take(&mut self, count: u8) -> Result<u32, JpegFault> {
        if count == 0 {
            return Ok(0);
        }
        self.fill();
        let value = self.buffer >> (32 - u32::from(count));
        self.drop(count)?;
        Ok(value)
    }

    fn drop(&mut self, count: u8) -> Result<(), JpegFault> {
        let count = u32::from(count);
        self.count = self.count.checked_sub(count).ok_or(JpegFault::CutShort(Part::EntropyCodedData))?;
        self.buffer <<= count;
        Ok(())
    }

    pub(super) fn bit(&mut self) -> Result<bool, JpegFault> {
        Ok(self.take(1)? == 1)
    }

    pub(super) fn symbol(&mut self, code: &Huffman) -> Result<u8, JpegFault> {
        self.fill();
        match code.lookup.get((self.buffer >> 16) as usize) {
            Some(&(symbol, length)) if length > 0 => self.drop(length).map(|()| symbol),
            Some(_) => Err(JpegFault::NoCode),
            None => Err(JpegFault::NoHuffmanTable),
        }
    }

    /// A number of `size` bits in JPEG's own signed form (T.81 F.2.2.1, EXTEND).
    pub(super) fn signed(&mut self, size: u8) -> Result<i32, JpegFault> {
        if size > 16 {
            return Err(JpegFault::CoefficientBits(size));
        }
        let value = self.take(size)?.cast_signed();
        let is_negative = size > 0 && value >> (size - 1) == 0;
        Ok(if is_negative { value - (1 << size) + 1 } else { value })
    }

    /// Skips to behind the next restart marker.
    pub(super) fn restart(&mut self) -> Result<(), JpegFault> {
        (self.buffer, self.count) = (0, 0);
        match self.data.get(self.position..) {
            Some([0xFF, 0xD0..=0xD7, ..]) => self.position += 2,
            _ => return Err(JpegFault::NoRestart),
        }
        Ok(())
    }

    /// The bytes after the entropy-coded data, from the next marker on.
    pub(super) fn behind(&self) -> &'a [u8] {
        let rest = self.data.get(self.position..).unwrap_or_default();
        let marker = rest.windows(2).position(|pair| pair[0] == 0xFF && !matches!(pair[1], 0 | 0xD0..=0xD7));
        marker.map_or(&[], |at| &rest[at..])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn jpeg_signed_numbers_extend_as_in_table_f_1() {
        // Three bits each: 000 is -7, 011 is -4, 100 is 4, 111 is 7.
        let mut bits = Bits::new(&[0b0000_1110, 0b0111_0000]);
        let found: Vec<i32> = (0..4).map(|_| bits.signed(3).unwrap()).collect();
        assert_eq!(found, [-7, -4, 4, 7]);
        assert!(bits.take(16).is_err());
    }
}
