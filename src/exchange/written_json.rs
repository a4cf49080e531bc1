//! JSON as it is written to files: an object's keys each on a line, arrays of numbers in one.

use std::io::{self, Write};

use serde::Serialize;
use serde_json::ser::Formatter;

use super::{ExchangeError, Format};

/// How deep the object is that is written.
#[derive(Default)]
struct Lines {
    depth: usize,
    is_empty: bool,
}

impl Lines {
    fn line<W: ?Sized + Write>(&self, writer: &mut W) -> io::Result<()> {
        writer.write_all(b"\n")?;
        (0..self.depth).try_for_each(|_| writer.write_all(b"  "))
    }
}

impl Formatter for Lines {
    fn begin_object<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.depth += 1;
        self.is_empty = true;
        writer.write_all(b"{")
    }

    fn end_object<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.depth -= 1;
        if !self.is_empty {
            self.line(writer)?;
        }
        self.is_empty = false;
        writer.write_all(b"}")
    }

    fn begin_object_key<W: ?Sized + Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        if !first {
            writer.write_all(b",")?;
        }
        self.line(writer)
    }

    fn begin_object_value<W: ?Sized + Write>(&mut self, writer: &mut W) -> io::Result<()> {
        self.is_empty = false;
        writer.write_all(b": ")
    }

    fn begin_array_value<W: ?Sized + Write>(&mut self, writer: &mut W, first: bool) -> io::Result<()> {
        writer.write_all(if first { b"" } else { b", " })
    }
}

/// The bytes of a file, with a line break at its end.
pub(super) fn bytes(format: Format, value: &impl Serialize) -> Result<Vec<u8>, ExchangeError> {
    let mut bytes = Vec::new();
    let mut serializer = serde_json::Serializer::with_formatter(&mut bytes, Lines::default());
    value.serialize(&mut serializer).map_err(|error| ExchangeError::Syntax {
        format,
        place: "writing".to_owned(),
        source: error.into(),
    })?;
    bytes.push(b'\n');
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keys_have_lines_and_numbers_do_not() {
        let value = serde_json::json!({"a": [1.5, 2], "b": [{"c": {}}, {"d": "x"}], "e": []});
        let text = String::from_utf8(bytes(Format::MrkJson, &value).unwrap()).unwrap();
        let expected = "{\n  \"a\": [1.5, 2],\n  \"b\": [{\n    \"c\": {}\n  }, {\n    \"d\": \"x\"\n  }],\n  \"e\": []\n}\n";
        assert_eq!(text, expected);
    }
}
