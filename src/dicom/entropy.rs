//! JPEG's entropy-coded data: Huffman codes and the bits they are read from (ITU-T T.81 annexes C
//! and F).

/// A fault of a codestream, for a message.
pub(super) type Problem = String;

/// A Huffman code as a table over the next 16 bits: symbol and length (0 where no code begins so).
#[derive(Default)]
pub(super) struct Huffman {
    lookup: Vec<(u8, u8)>,
}

impl Huffman {
    /// The canonical code with `counts[n]` codes of n + 1 bits (T.81 annex C).
    pub(super) fn new(counts: &[u8], symbols: &[u8]) -> Result<Self, Problem> {
        let mut lookup = vec![(0, 0); 1 << 16];
        let lengths =
            (1u8..).zip(counts).flat_map(|(length, &count)| std::iter::repeat_n(length, count.into()));
        let mut next = 0usize;
        for (length, &symbol) in lengths.zip(symbols) {
            let span = 1usize << (16 - length);
            let entries = lookup.get_mut(next..next + span).ok_or("the Huffman table has too many codes")?;
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
    pub(super) fn take(&mut self, count: u8) -> Result<u32, Problem> {
        if count == 0 {
            return Ok(0);
        }
        self.fill();
        let value = self.buffer >> (32 - u32::from(count));
        self.drop(count)?;
        Ok(value)
    }

    fn drop(&mut self, count: u8) -> Result<(), Problem> {
        let count = u32::from(count);
        self.count = self.count.checked_sub(count).ok_or("the entropy-coded data are cut short")?;
        self.buffer <<= count;
        Ok(())
    }

    pub(super) fn bit(&mut self) -> Result<bool, Problem> {
        Ok(self.take(1)? == 1)
    }

    pub(super) fn symbol(&mut self, code: &Huffman) -> Result<u8, Problem> {
        self.fill();
        match code.lookup.get((self.buffer >> 16) as usize) {
            Some(&(symbol, length)) if length > 0 => self.drop(length).map(|()| symbol),
            Some(_) => Err("found bits that no Huffman code begins with".to_owned()),
            None => Err("a Huffman table is missing".to_owned()),
        }
    }

    /// A number of `size` bits in JPEG's own signed form (T.81 F.2.2.1, EXTEND).
    pub(super) fn signed(&mut self, size: u8) -> Result<i32, Problem> {
        if size > 16 {
            return Err(format!("found a coefficient of {size} bits, expected at most 16"));
        }
        let value = self.take(size)?.cast_signed();
        let is_negative = size > 0 && value >> (size - 1) == 0;
        Ok(if is_negative { value - (1 << size) + 1 } else { value })
    }

    /// Skips to behind the next restart marker.
    pub(super) fn restart(&mut self) -> Result<(), Problem> {
        (self.buffer, self.count) = (0, 0);
        match self.data.get(self.position..) {
            Some([0xFF, 0xD0..=0xD7, ..]) => self.position += 2,
            _ => return Err("found no restart marker where one is expected".to_owned()),
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
