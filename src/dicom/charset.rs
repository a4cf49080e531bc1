//! Text of a data set in the character sets that it names: Specific Character Set (0008,0005).
//!
//! Follows PS3.3 C.12.1.1.2 (the terms) and PS3.5 6.1.2.5 (code extensions of ISO 2022). A text has
//! a lower half, codes 21 to 7E, and an upper one, codes A0 to FF. Escape sequences put another set
//! into a half, and a delimiter restores the sets of the first value. The sets themselves are those
//! of `encoding_rs`. This module does not encode: objects are written in UTF-8.

use dicom_core::dictionary::{DataDictionary, DataDictionaryEntry};
use dicom_core::{Tag, VR};
use dicom_dictionary_std::{StandardDataDictionary, tags};
use encoding_rs::{
    EUC_JP, EUC_KR, Encoding, GB18030, GBK, ISO_8859_2, ISO_8859_3, ISO_8859_4, ISO_8859_5, ISO_8859_6,
    ISO_8859_7, ISO_8859_8, ISO_8859_15, UTF_8, WINDOWS_874, WINDOWS_1252, WINDOWS_1254,
};

use super::dataset::DataSet;

const ESCAPE: u8 = 0x1B;

/// The character sets of a data set.
#[derive(Clone, Copy, Debug)]
pub(super) struct Charset(Repertoire);

#[derive(Clone, Copy, Debug)]
enum Repertoire {
    /// No known set is named.
    Unnamed,
    /// A set without code extensions, which has all characters.
    Whole(&'static Encoding),
    /// The upper half at the beginning and behind each delimiter. The lower one is ASCII.
    Extended(Option<Upper>),
}

/// The set of the lower half.
#[derive(Clone, Copy, Debug)]
enum Lower {
    /// Also for the romaji of JIS X 0201, which differ from it in the yen sign and the overline: their
    /// codes are those of the backslash, which divides values, and of the tilde.
    Ascii,
    /// Two bytes a character.
    Jis0208,
    Jis0212,
}

/// The set of the upper half.
#[derive(Clone, Copy, Debug)]
enum Upper {
    One(&'static Encoding),
    /// The katakana of JIS X 0201.
    Katakana,
    /// Two bytes a character.
    Two(&'static Encoding),
}

#[derive(Clone, Copy, Debug)]
enum Half {
    Lower(Lower),
    Upper(Upper),
}

/// The sets that a text can change to: their number in the ISO register, the escape sequence
/// without its first byte, the half that it changes.
///
/// Of Windows' supersets only the upper codes from A0 are used, where they are the same.
static EXTENSIONS: [(&str, &[u8], Half); 18] = [
    ("6", b"(B", Half::Lower(Lower::Ascii)),
    ("13", b")I", Half::Upper(Upper::Katakana)),
    ("13", b"(J", Half::Lower(Lower::Ascii)),
    ("100", b"-A", Half::Upper(Upper::One(WINDOWS_1252))),
    ("101", b"-B", Half::Upper(Upper::One(ISO_8859_2))),
    ("109", b"-C", Half::Upper(Upper::One(ISO_8859_3))),
    ("110", b"-D", Half::Upper(Upper::One(ISO_8859_4))),
    ("126", b"-F", Half::Upper(Upper::One(ISO_8859_7))),
    ("127", b"-G", Half::Upper(Upper::One(ISO_8859_6))),
    ("138", b"-H", Half::Upper(Upper::One(ISO_8859_8))),
    ("144", b"-L", Half::Upper(Upper::One(ISO_8859_5))),
    ("148", b"-M", Half::Upper(Upper::One(WINDOWS_1254))),
    ("166", b"-T", Half::Upper(Upper::One(WINDOWS_874))),
    ("203", b"-b", Half::Upper(Upper::One(ISO_8859_15))),
    ("58", b"$)A", Half::Upper(Upper::Two(GBK))),
    ("149", b"$)C", Half::Upper(Upper::Two(EUC_KR))),
    ("87", b"$B", Half::Lower(Lower::Jis0208)),
    ("159", b"$(D", Half::Lower(Lower::Jis0212)),
];

impl Charset {
    /// The character sets of an object.
    pub(super) fn of(data: &DataSet) -> Self {
        Self(Repertoire::Unnamed).within(data)
    }

    /// The character sets of an item of a sequence: its own, or those of the data set around it.
    pub(super) fn within(self, item: &DataSet) -> Self {
        item.text(tags::SPECIFIC_CHARACTER_SET).map_or(self, |named| Self(Repertoire::named(&named)))
    }

    /// A text value without its padding; `None` when absent. Invalid bytes become
    /// replacement characters.
    pub(super) fn text(self, data: &DataSet, tag: Tag) -> Option<String> {
        let text = self.0.decode(data.bytes(tag)?, delimiters(tag));
        Some(text.trim_matches(['\0', ' ', '\t', '\r', '\n']).to_owned())
    }
}

/// Behind these characters a text is again in the sets of the first value; so it is behind
/// characters of control (PS3.5 6.1.2.5.3).
fn delimiters(tag: Tag) -> &'static [u8] {
    match StandardDataDictionary.by_tag(tag).map(|entry| entry.vr().relaxed()) {
        Some(VR::PN) => br"\^=",
        Some(VR::UT | VR::LT | VR::ST) => b"",
        _ => br"\",
    }
}

impl Repertoire {
    /// Of the values of Specific Character Set. Unknown ones are ignored.
    fn named(values: &str) -> Self {
        let mut uppers = Vec::new();
        let mut is_known = false;
        for (at, value) in values.split('\\').map(str::trim).enumerate() {
            match value {
                "ISO_IR 192" | "ISO_IR_192" => return Self::Whole(UTF_8),
                "GB18030" => return Self::Whole(GB18030),
                "GBK" | "GB2312" => return Self::Whole(GBK),
                _ => {}
            }
            let number =
                ["ISO_IR ", "ISO_IR_", "ISO 2022 IR "].iter().find_map(|term| value.strip_prefix(term));
            let known = EXTENSIONS.iter().find(|(known, ..)| number == Some(known));
            // A first value that is empty is ASCII.
            is_known |= known.is_some() || (at == 0 && value.is_empty());
            if let Some((_, _, Half::Upper(upper))) = known {
                uppers.push((at, *upper));
            }
        }
        // Some writers leave out the escape sequence of the only set that they can mean.
        match uppers.as_slice() {
            _ if !is_known || values.trim().is_empty() => Self::Unnamed,
            [(0, upper), ..] | [(_, upper)] => Self::Extended(Some(*upper)),
            _ => Self::Extended(None),
        }
    }

    fn decode(self, bytes: &[u8], delimiters: &[u8]) -> String {
        match self {
            Self::Unnamed => guess(bytes),
            Self::Whole(encoding) => encoding.decode_without_bom_handling(bytes).0.into_owned(),
            Self::Extended(upper) => decode_extended(bytes, upper, delimiters),
        }
    }
}

/// UTF-8, or else Latin 1.
fn guess(bytes: &[u8]) -> String {
    str::from_utf8(bytes).map_or_else(|_| bytes.iter().map(|&byte| char::from(byte)).collect(), str::to_owned)
}

fn decode_extended(bytes: &[u8], first: Option<Upper>, delimiters: &[u8]) -> String {
    let mut text = String::new();
    let (mut lower, mut upper) = (Lower::Ascii, first);
    let mut rest = bytes;
    while let Some(&byte) = rest.first() {
        if byte == ESCAPE
            && let Some((sequence, half)) = extension(&rest[1..])
        {
            match half {
                Half::Lower(set) => lower = set,
                Half::Upper(set) => upper = Some(set),
            }
            rest = &rest[1 + sequence.len()..];
            continue;
        }
        // Some writers leave out the escape before a delimiter. The next escape follows it directly.
        let is_followed = rest.get(1).is_some_and(|next| (0x21..=0x7E).contains(next));
        let length = match (byte, lower, upper) {
            (0x21..=0x7E, Lower::Jis0208 | Lower::Jis0212, _) if is_followed => 2,
            (0x80.., _, Some(Upper::Two(_))) => 2,
            (0x80.., _, None) => rest.iter().take_while(|&&byte| byte >= 0x80).count(),
            _ => 1,
        };
        let (character, behind) = rest.split_at(length.min(rest.len()));
        rest = behind;
        match (byte, character) {
            (0x80.., _) => decode_upper(character, upper, &mut text),
            (0x21..=0x7E, &[a, b]) => {
                let in_euc = [0x8F, a | 0x80, b | 0x80];
                let in_euc = if matches!(lower, Lower::Jis0212) { &in_euc[..] } else { &in_euc[1..] };
                text.push_str(&EUC_JP.decode_without_bom_handling(in_euc).0);
            }
            (0x21..=0x7E, _) if !matches!(lower, Lower::Ascii) && !delimiters.contains(&byte) => {
                text.push(char::REPLACEMENT_CHARACTER);
            }
            _ => {
                text.push(char::from(byte));
                if byte < 0x20 || delimiters.contains(&byte) {
                    (lower, upper) = (Lower::Ascii, first);
                }
            }
        }
    }
    text
}

/// The extension that begins behind an escape.
fn extension(bytes: &[u8]) -> Option<(&'static [u8], Half)> {
    let found = EXTENSIONS.iter().find(|(_, sequence, _)| bytes.starts_with(sequence))?;
    Some((found.1, found.2))
}

/// A character of the upper half; several where no set is there to tell their length.
fn decode_upper(character: &[u8], upper: Option<Upper>, text: &mut String) {
    match (upper, character) {
        (None, _) => text.push_str(&guess(character)),
        (Some(Upper::Katakana), &[byte @ 0xA1..=0xDF, ..]) => {
            text.push(char::from_u32(0xFF61 + u32::from(byte) - 0xA1).unwrap_or(char::REPLACEMENT_CHARACTER));
        }
        (Some(Upper::Katakana), _) => text.push(char::REPLACEMENT_CHARACTER),
        (Some(Upper::One(_)), &[byte @ 0x80..=0x9F, ..]) => text.push(char::from(byte)),
        (Some(Upper::One(set) | Upper::Two(set)), _) => {
            text.push_str(&set.decode_without_bom_handling(character).0);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NAME: &[u8] = br"\^=";

    /// The examples of PS3.5 annexes H (Japanese), I (Korean), J (Chinese) and K.
    #[test]
    fn the_names_of_the_standard_are_decoded() {
        let examples: [(&str, &[u8], &str); 7] = [
            (
                r"\ISO 2022 IR 87",
                b"Yamada^Tarou=\x1b$B;3ED\x1b(B^\x1b$BB@O:\x1b(B=\x1b$B$d$^$@\x1b(B^\x1b$B$?$m$&\x1b(B",
                "Yamada^Tarou=山田^太郎=やまだ^たろう",
            ),
            (
                r"ISO 2022 IR 13\ISO 2022 IR 87",
                b"\xd4\xcf\xc0\xde^\xc0\xdb\xb3=\x1b$B;3ED\x1b(J^\x1b$BB@O:\x1b(J=\x1b$B$d$^$@\x1b(J^\x1b$B$?$m$&\x1b(J",
                "ﾔﾏﾀﾞ^ﾀﾛｳ=山田^太郎=やまだ^たろう",
            ),
            (
                r"\ISO 2022 IR 149",
                b"Hong^Gildong=\x1b$)C\xfb\xf3^\x1b$)C\xd1\xce\xd4\xd7=\x1b$)C\xc8\xab^\x1b$)C\xb1\xe6\xb5\xbf",
                "Hong^Gildong=洪^吉洞=홍^길동",
            ),
            (
                r"\ISO 2022 IR 58",
                b"Zhang^XiaoDong=\x1b$)A\xd5\xc5^\x1b$)A\xd0\xa1\xb6\xab=",
                "Zhang^XiaoDong=张^小东=",
            ),
            ("GB18030", b"Wang^XiaoDong=\xcd\xf5^\xd0\xa1\xb6\xab", "Wang^XiaoDong=王^小东"),
            (
                "ISO_IR 192",
                b"Wang^XiaoDong=\xe7\x8e\x8b^\xe5\xb0\x8f\xe6\x9d\xb1",
                "Wang^XiaoDong=王^小東",
            ),
            ("ISO_IR 100", b"Buc^J\xe9r\xf4me", "Buc^Jérôme"),
        ];
        for (named, bytes, expected) in examples {
            assert_eq!(Repertoire::named(named).decode(bytes, NAME), expected, "{named}");
        }
    }

    #[test]
    fn a_backslash_inside_of_a_character_divides_nothing() {
        // The second byte of both is 5C.
        assert_eq!(Repertoire::named("GBK").decode(b"\x8c\x5c", br"\"), "孿");
        let japanese = Repertoire::named(r"\ISO 2022 IR 87");
        assert_eq!(japanese.decode(b"\x1b$B\x30\x5c\x1b(B", br"\"), "移");
    }

    #[test]
    fn a_delimiter_ends_a_set() {
        let greek = Repertoire::named(r"ISO 2022 IR 100\ISO 2022 IR 126");
        assert_eq!(greek.decode(b"\xe9\x1b-F\xe9^\xe9", NAME), "éι^é");
        assert_eq!(greek.decode(b"\xe9\x1b-F\xe9^\xe9", b""), "éι^ι");
    }

    #[test]
    fn a_delimiter_without_an_escape_before_it_ends_a_set_of_two_bytes() {
        let japanese = Repertoire::named(r"ISO 2022 IR 100\ISO 2022 IR 87");
        let bytes = b"M\xfcller=\x1b$B;3ED^\x1b$BB@O:";
        assert_eq!(japanese.decode(bytes, NAME), "Müller=山田^太郎");
    }

    #[test]
    fn bytes_without_a_set_are_utf8_or_else_latin_1() {
        for named in ["", "ISO_IR 6", "NO SUCH SET", r"\ISO 2022 IR 87"] {
            assert_eq!(Repertoire::named(named).decode("é".as_bytes(), NAME), "é", "{named}");
            assert_eq!(Repertoire::named(named).decode(b"\xe9", NAME), "é", "{named}");
        }
        // The only set of the upper half, without its escape sequence.
        assert_eq!(Repertoire::named(r"\ISO 2022 IR 149").decode(b"\xb0\xa3", NAME), "간");
    }

    #[test]
    fn cut_characters_and_unknown_escapes_are_marked() {
        let korean = Repertoire::named(r"\ISO 2022 IR 149");
        assert_eq!(korean.decode(b"a\xb0", NAME), "a\u{fffd}");
        let japanese = Repertoire::named(r"\ISO 2022 IR 87");
        assert_eq!(japanese.decode(b"\x1b$B;", NAME), "\u{fffd}");
        assert_eq!(japanese.decode(b"a\x1b", NAME), "a\u{1b}");
    }
}
