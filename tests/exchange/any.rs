//! Any bytes end in items or an error, never in a panic.

use proptest::prelude::*;
use proptest::sample::Index;

use super::{TEXTS, everything, read, write};
use relief_exchange::Format;

/// Changes to a good file: changed bytes, cuts, repetitions, and words that formats know.
#[derive(Clone, Debug)]
enum Blow {
    Set(Index, u8),
    Cut(Index, usize),
    Twice(Index, usize),
    Put(Index, &'static str),
}

fn blow() -> impl Strategy<Value = Blow> {
    let words = vec![
        "null",
        "{",
        "}",
        "[",
        "]",
        "\"",
        ",",
        "\n",
        "-1",
        "1e308",
        "1e-400",
        "0.1",
        "true",
        "nan",
        "#",
        "<",
        "</point>",
        "&",
        "<point>",
        "\u{feff}",
        "RAS",
        "undefined",
        "\\u0000",
        "0x1",
        "99999999999999999999",
    ];
    prop_oneof![
        (any::<Index>(), any::<u8>()).prop_map(|(at, byte)| Blow::Set(at, byte)),
        (any::<Index>(), 1..200usize).prop_map(|(at, count)| Blow::Cut(at, count)),
        (any::<Index>(), 1..200usize).prop_map(|(at, count)| Blow::Twice(at, count)),
        (any::<Index>(), proptest::sample::select(words)).prop_map(|(at, word)| Blow::Put(at, word)),
    ]
}

fn strike(bytes: &mut Vec<u8>, blow: &Blow) {
    if bytes.is_empty() {
        return;
    }
    let span =
        |at: &Index, count: usize| at.index(bytes.len())..(at.index(bytes.len()) + count).min(bytes.len());
    match blow {
        Blow::Set(at, byte) => {
            let at = at.index(bytes.len());
            bytes[at] = *byte;
        }
        Blow::Cut(at, count) => drop(bytes.drain(span(at, *count))),
        Blow::Twice(at, count) => {
            let part = bytes[span(at, *count)].to_vec();
            let at = at.index(bytes.len());
            bytes.splice(at..at, part);
        }
        Blow::Put(at, word) => {
            let at = at.index(bytes.len());
            bytes.splice(at..at, word.bytes());
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    /// Invariant: An annotation file is imported completely or not at all, and LPS and RAS are
    /// distinguished in every format.
    #[test]
    fn damaged_files_end_in_valid_items_or_an_error(blows in proptest::collection::vec(blow(), 1..6), of in 0..TEXTS.len()) {
        let format = TEXTS[of];
        let mut bytes = write(format, &everything()).unwrap().bytes;
        for blow in &blows {
            strike(&mut bytes, blow);
        }
        if let Ok(imported) = read(format, &bytes) {
            for item in &imported.items {
                prop_assert!(item.validate().is_ok());
            }
            // Whatever was taken can be written again.
            if !imported.items.is_empty() {
                prop_assert!(write(Format::MrkJson, &imported.items).is_ok());
            }
        }
    }

    #[test]
    fn any_bytes_end_in_items_or_an_error(bytes in proptest::collection::vec(any::<u8>(), 0..400)) {
        for format in Format::ALL {
            let _ = read(format, &bytes);
        }
    }

    #[test]
    fn any_text_ends_in_items_or_an_error(text in "[\\[\\]{}\":,a-z0-9#=\n<>/ .-]{0,200}") {
        for format in Format::ALL {
            let _ = read(format, &text);
        }
    }
}
