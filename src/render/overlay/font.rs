//! A stroke font of our own: letters as lines of one width, which stay readable on lenticular
//! displays and at any size.
//!
//! Units: capitals are 12 high, small letters 8, descenders go down to -4; x to the right, y up
//! from the baseline. A glyph is a list of strokes with `;` between them, a stroke a list of points
//! `x,y`. A stroke that begins with `~` is a smooth curve through its points, with `o` a smooth
//! closed one, else straight from point to point; one point is a dot.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use glam::{DVec2, DVec3};

use relief_annotation::catmull_rom;

/// Height of capitals.
pub const CAPITAL: f64 = 12.0;

/// From one glyph's last ink to the next one's first.
const GAP: f64 = 3.2;

/// Width of a blank.
const BLANK: f64 = 5.0;

/// Straight parts of a span of a smooth stroke.
const PARTS: usize = 4;

/// The axes of a glyph's strokes and the advance of the pen.
#[derive(Clone, Debug)]
pub(super) struct Glyph {
    pub(super) segments: Vec<[DVec2; 2]>,
    /// From the glyph's left end to the next glyph's.
    pub(super) advance: f64,
}

/// The glyph of a character. One that the font does not have is a box.
pub(super) fn glyph(character: char) -> &'static Glyph {
    static FONT: LazyLock<BTreeMap<char, Glyph>> = LazyLock::new(font);
    static MISSING: LazyLock<Glyph> = LazyLock::new(|| Glyph::new("0,0 0,12 7,12 7,0 0,0"));
    /// The most frequent characters, at their indices.
    static ASCII: LazyLock<[&Glyph; 128]> = LazyLock::new(|| {
        std::array::from_fn(|code| u8::try_from(code).map_or(&*MISSING, |code| find(char::from(code))))
    });
    fn find(character: char) -> &'static Glyph {
        FONT.get(&character).unwrap_or(&MISSING)
    }
    ASCII.get(character as usize).copied().unwrap_or_else(|| find(character))
}

/// A line of text as strokes: from its first ink at x = 0, its baseline at y = 0, in the units of
/// the font; and its advance to the right.
///
/// For drawings that are no picture of a volume; capitals are [`CAPITAL`] high.
#[must_use]
pub fn lettering(text: &str) -> (Vec<[DVec2; 2]>, f64) {
    let (mut segments, mut x) = (Vec::new(), 0.0);
    for character in text.chars() {
        let glyph = glyph(character);
        segments.extend(glyph.segments.iter().map(|ends| ends.map(|end| end + DVec2::new(x, 0.0))));
        x += glyph.advance;
    }
    (segments, (x - GAP).max(0.0))
}

fn font() -> BTreeMap<char, Glyph> {
    let mut font: BTreeMap<_, _> =
        GLYPHS.iter().map(|&(character, strokes)| (character, Glyph::new(strokes))).collect();
    for (accent, pairs) in ACCENTS {
        let accent = Glyph::new(accent);
        let mut pairs = pairs.chars();
        while let (Some(character), Some(base)) = (pairs.next(), pairs.next()) {
            let accented = font.get(&base).map(|glyph| glyph.with_accent(&accent, base.is_uppercase()));
            font.extend(accented.map(|glyph| (character, glyph)));
        }
    }
    font
}

impl Glyph {
    fn new(strokes: &str) -> Self {
        let mut segments = Vec::new();
        for stroke in strokes.split(';').map(str::trim).filter(|stroke| !stroke.is_empty()) {
            let points = points(stroke.trim_start_matches(['~', 'o']));
            let line = match stroke.as_bytes()[0] {
                b'~' => catmull_rom(&points, false, PARTS),
                b'o' => catmull_rom(&points, true, PARTS),
                _ => points,
            };
            let flat: Vec<DVec2> = line.into_iter().map(DVec3::truncate).collect();
            match flat.as_slice() {
                [dot] => segments.push([*dot, *dot]),
                line => segments.extend(line.windows(2).map(|ends| [ends[0], ends[1]])),
            }
        }
        let right = segments.iter().flatten().map(|end| end.x).fold(f64::NEG_INFINITY, f64::max);
        let advance = if right.is_finite() { right + GAP } else { BLANK };
        Self { segments, advance }
    }

    /// From its left end to its last ink.
    pub(super) fn width(&self) -> f64 {
        self.advance - GAP
    }

    /// This one with an accent, drawn for small letters around x = 0, above its middle.
    fn with_accent(&self, accent: &Self, is_capital: bool) -> Self {
        let up = if is_capital { CAPITAL - 8.0 } else { 0.0 };
        let shift = DVec2::new(self.width() / 2.0, up);
        let moved = accent.segments.iter().map(|ends| ends.map(|end| end + shift));
        Self { segments: self.segments.iter().copied().chain(moved).collect(), advance: self.advance }
    }
}

fn points(stroke: &str) -> Vec<DVec3> {
    let point = |text: &str| {
        let (x, y) = text.split_once(',')?;
        Some(DVec3::new(x.parse().ok()?, y.parse().ok()?, 0.0))
    };
    stroke.split_whitespace().filter_map(point).collect()
}

/// Accents, and pairs of an accented letter and its base.
const ACCENTS: [(&str, &str); 6] = [
    ("-1.6,10.8; 1.6,10.8", "äaöoüuëeÄAÖOÜUËE"),
    ("-0.8,9.8 1,12", "áaéeóoúuÁAÉEÓOÚU"),
    ("0.8,9.8 -1,12", "àaèeòoùuÀAÈEÒOÙU"),
    ("-1.8,9.8 0,11.8 1.8,9.8", "âaêeôoûuÂAÊEÔOÛU"),
    ("~-2,10.2 -1,11.2 0,10.7 1,10.2 2,11.2", "ñnãaõoÑNÃAÕO"),
    ("o0,12.2 -1.2,11 0,9.8 1.2,11", "åaÅA"),
];

#[rustfmt::skip]
const GLYPHS: [(char, &str); 102] = [
    (' ', ""),
    ('!', "0.6,12 0.6,3.6; 0.6,0"),
    ('"', "0.4,12 0.4,8.6; 3,12 3,8.6"),
    ('#', "2.4,12 1.4,0; 6.2,12 5.2,0; 0.2,8 7.6,8; 0,4 7.4,4"),
    ('$', "~7.2,10 5.8,11.6 3.8,12 1.4,11.2 0.4,9.2 1.4,7.2 3.8,6.2 6.4,5.1 7.5,3 6.4,0.8 3.8,0 1.4,0.6 0,2.4; 3.8,13.8 3.8,-1.8"),
    ('%', "8.4,12 0.6,0; o2,12 0.6,11.2 0,9.4 0.6,7.6 2,6.8 3.4,7.6 4,9.4 3.4,11.2; o7,5.2 5.6,4.4 5,2.6 5.6,0.8 7,0 8.4,0.8 9,2.6 8.4,4.4"),
    ('&', "~8.2,5.4 6.6,1.8 3.2,0 0.8,0.9 0,3 1,5.2 3.4,6.9 5,8.4 5.4,10.2 4.6,11.6 3.2,12 1.8,11.4 1.4,9.8 2.4,7.4 8.6,0"),
    ('\'', "0.4,12 0.4,8.6"),
    ('(', "~2.6,14 0.8,10.8 0,5.5 0.8,0.2 2.6,-3"),
    (')', "~0,14 1.8,10.8 2.6,5.5 1.8,0.2 0,-3"),
    ('*', "2.8,11.5 2.8,5.5; 0.2,10 5.4,7; 5.4,10 0.2,7"),
    ('+', "0,5.5 7,5.5; 3.5,9 3.5,2"),
    (',', "0.8,0.2 0,-2.4"),
    ('-', "0,5.2 4.4,5.2"),
    ('\u{2212}', "0,5.2 6.2,5.2"),
    ('.', "0.5,0"),
    ('/', "0,-1.5 5,13"),
    ('0', "o3.6,12 1.2,10.6 0,6 1.2,1.4 3.6,0 6,1.4 7.2,6 6,10.6"),
    ('1', "0.6,9.6 3.2,12 3.2,0; 0.6,0 5.8,0"),
    ('2', "~0.2,9.4 1.2,11.3 3.5,12 5.9,11.1 6.8,8.8 5.8,6.4 3.2,3.6 0,0; 0,0 7,0"),
    ('3', "~0.4,10.4 1.8,11.7 3.6,12 5.8,11.1 6.5,9.2 5.6,7.2 3.2,6.4; ~3.2,6.4 5.9,5.6 7,3.3 5.9,0.9 3.4,0 1.4,0.4 0,1.8"),
    ('4', "5.2,0 5.2,12 0,3.6 7.2,3.6"),
    ('5', "6.4,12 1,12 0.5,6.6; ~0.5,6.6 1.8,7.4 3.6,7.7 6,6.6 7,3.9 6,1.2 3.4,0 1.4,0.5 0,1.8"),
    ('6', "~6,11.4 4.2,12 2,10.9 0.5,8 0.1,4.2 1.2,1.2 3.6,0 6,1.1 7,3.8 6,6.4 3.7,7.4 1.4,6.4 0.2,4"),
    ('7', "0,12 7,12 2.4,0"),
    ('8', "o3.6,6.4 1.3,7.3 0.5,9.2 1.3,11.2 3.6,12 5.9,11.2 6.7,9.2 5.9,7.3; o3.6,6.4 1,5.4 0,3.2 1,0.9 3.6,0 6.2,0.9 7.2,3.2 6.2,5.4"),
    ('9', "~1,0.6 2.8,0 5,1.1 6.5,4 6.9,7.8 5.8,10.8 3.4,12 1,10.9 0,8.2 1,5.6 3.3,4.6 5.6,5.6 6.8,8"),
    (':', "0.5,0; 0.5,7"),
    (';', "0.8,7; 0.8,0.2 0,-2.4"),
    ('<', "6,10 0,5.5 6,1"),
    ('=', "0,7.4 7,7.4; 0,3.6 7,3.6"),
    ('>', "0,10 6,5.5 0,1"),
    ('?', "~0,9.6 1.2,11.4 3.2,12 5.4,11.2 6.2,9.2 5.4,7.2 3.9,5.9 3.2,4.4 3.1,3.4; 3.1,0"),
    ('@', "~6.6,3.4 5,2.6 3.6,3.2 3,5.2 3.8,7.6 5.6,8.4 7,7.6; 7.2,8.2 6.8,4; ~6.8,4 7.4,2.6 8.8,3.2 10,6 9,9.8 5.6,12 2,10.6 0,6 1.6,1.2 5.4,-1 8.6,-0.2"),
    ('A', "0,0 4,12 8,0; 1.3,4 6.7,4"),
    ('B', "0,0 0,12 4,12; ~4,12 6.5,11.2 7,9.3 6.2,7.3 4,6.5; 0,6.5 4,6.5; ~4,6.5 7,5.6 7.7,3.2 6.8,0.8 4.4,0; 0,0 4.4,0"),
    ('C', "~7.8,9.6 6.4,11.5 4.2,12 1.6,10.8 0.2,8 0.2,4 1.6,1.2 4.2,0 6.4,0.5 7.8,2.4"),
    ('D', "3.5,0 0,0 0,12 3.5,12; ~3.5,12 6.5,10.6 8,6 6.5,1.4 3.5,0"),
    ('E', "7,12 0,12 0,0 7,0; 0,6.3 5.8,6.3"),
    ('F', "7,12 0,12 0,0; 0,6.3 5.6,6.3"),
    ('G', "~7.8,9.6 6.4,11.5 4.2,12 1.6,10.8 0.2,8 0.2,4 1.6,1.2 4.2,0 6.4,0.6 7.8,2.2; 7.8,2.2 7.8,5.6 4.8,5.6"),
    ('H', "0,0 0,12; 8,0 8,12; 0,6.2 8,6.2"),
    ('I', "0,12 4,12; 2,12 2,0; 0,0 4,0"),
    ('J', "6,12 6,3; ~6,3 5.2,0.8 3,0 0.8,0.8 0,3"),
    ('K', "0,0 0,12; 7.5,12 0,4.6; 2.6,7.2 7.8,0"),
    ('L', "0,12 0,0 6.8,0"),
    ('M', "0,0 0,12 4.5,4 9,12 9,0"),
    ('N', "0,0 0,12 8,0 8,12"),
    ('O', "o4.2,12 1.5,10.7 0,7.5 0,4.5 1.5,1.3 4.2,0 6.9,1.3 8.4,4.5 8.4,7.5 6.9,10.7"),
    ('P', "0,0 0,12 4.2,12; ~4.2,12 6.8,11 7.6,8.8 6.8,6.6 4.2,5.6; 4.2,5.6 0,5.6"),
    ('Q', "o4.2,12 1.5,10.7 0,7.5 0,4.5 1.5,1.3 4.2,0 6.9,1.3 8.4,4.5 8.4,7.5 6.9,10.7; 5.2,3 8.6,-0.8"),
    ('R', "0,0 0,12 4.2,12; ~4.2,12 6.8,11 7.6,8.8 6.8,6.6 4.2,5.6; 4.2,5.6 0,5.6; 4,5.6 7.8,0"),
    ('S', "~7.2,10 5.8,11.6 3.8,12 1.4,11.2 0.4,9.2 1.4,7.2 3.8,6.2 6.4,5.1 7.5,3 6.4,0.8 3.8,0 1.4,0.6 0,2.4"),
    ('T', "0,12 8,12; 4,12 4,0"),
    ('U', "0,12 0,4; ~0,4 1.1,1.1 4,0 6.9,1.1 8,4; 8,4 8,12"),
    ('V', "0,12 4,0 8,12"),
    ('W', "0,12 2.6,0 5,9 7.4,0 10,12"),
    ('X', "0,12 8,0; 8,12 0,0"),
    ('Y', "0,12 4,6 8,12; 4,6 4,0"),
    ('Z', "0,12 7.6,12 0,0 7.8,0"),
    ('[', "2.6,14 0,14 0,-3 2.6,-3"),
    ('\\', "0,13 5,-1.5"),
    (']', "0,14 2.6,14 2.6,-3 0,-3"),
    ('^', "0,8 3,12 6,8"),
    ('_', "0,-2.5 7,-2.5"),
    ('`', "0,12 1.8,10"),
    ('a', "o3.1,8 0.9,6.9 0,4 0.9,1.1 3.1,0 5.2,1.2 6,4 5.2,6.8; 6,8 6,0"),
    ('b', "0,12 0,0; o2.9,8 0.8,6.8 0,4 0.8,1.2 2.9,0 5.1,1.1 6,4 5.1,6.9"),
    ('c', "~5.6,6.6 4.6,7.7 3.1,8 0.9,6.9 0,4 0.9,1.1 3.1,0 4.6,0.3 5.6,1.4"),
    ('d', "6,12 6,0; o3.1,8 0.9,6.9 0,4 0.9,1.1 3.1,0 5.2,1.2 6,4 5.2,6.8"),
    ('e', "0.1,4.3 5.9,4.3; ~5.9,4.3 5.2,7 3.1,8 0.9,6.9 0,4 0.9,1.1 3.2,0 4.8,0.4 5.8,1.6"),
    ('f', "~4.6,11.6 3.4,12 2.2,11.4 1.8,9.6; 1.8,9.6 1.8,0; 0,8 4.2,8"),
    ('g', "o3.1,8 0.9,6.9 0,4 0.9,1.1 3.1,0 5.2,1.2 6,4 5.2,6.8; 6,8 6,-1.2; ~6,-1.2 5.2,-3.3 3,-4 1.2,-3.6 0.4,-2.6"),
    ('h', "0,12 0,0; ~0,5.2 1,7.2 3,8 5,7.2 5.6,5; 5.6,5 5.6,0"),
    ('i', "0.6,8 0.6,0; 0.6,11"),
    ('j', "2.2,8 2.2,-2; ~2.2,-2 1.6,-3.6 0,-4; 2.2,11"),
    ('k', "0,12 0,0; 5.2,8 0,3.2; 1.9,4.9 5.6,0"),
    ('l', "0.4,12 0.4,1.6; ~0.4,1.6 0.9,0.3 2.2,0"),
    ('m', "0,8 0,0; ~0,5.2 0.9,7.3 2.6,8 4.1,7.2 4.6,5; 4.6,5 4.6,0; ~4.6,5.2 5.5,7.3 7.2,8 8.7,7.2 9.2,5; 9.2,5 9.2,0"),
    ('n', "0,8 0,0; ~0,5.2 1,7.2 3,8 5,7.2 5.6,5; 5.6,5 5.6,0"),
    ('o', "o3.1,8 0.9,6.9 0,4 0.9,1.1 3.1,0 5.3,1.1 6.2,4 5.3,6.9"),
    ('p', "0,8 0,-4; o2.9,8 0.8,6.8 0,4 0.8,1.2 2.9,0 5.1,1.1 6,4 5.1,6.9"),
    ('q', "6,8 6,-4; o3.1,8 0.9,6.9 0,4 0.9,1.1 3.1,0 5.2,1.2 6,4 5.2,6.8"),
    ('r', "0,8 0,0; ~0,5 0.9,7.2 2.4,8 4,7.8"),
    ('s', "~5.2,6.6 4.2,7.7 2.7,8 0.8,7.2 0.4,5.8 1.2,4.6 2.8,4.1 4.6,3.5 5.4,2.2 4.6,0.6 2.7,0 1,0.4 0,1.5"),
    ('t', "1.8,11 1.8,2; ~1.8,2 2.3,0.4 3.6,0 4.6,0.3; 0,8 4.2,8"),
    ('u', "0,8 0,3; ~0,3 0.6,0.8 2.6,0 4.6,0.8 5.6,2.8; 5.6,8 5.6,0"),
    ('v', "0,8 3,0 6,8"),
    ('w', "0,8 2,0 4,6.4 6,0 8,8"),
    ('x', "0,8 5.6,0; 5.6,8 0,0"),
    ('y', "0,8 3,0.4; 6,8 3,0.2 2.2,-2.4; ~2.2,-2.4 1.4,-3.7 0,-4"),
    ('z', "0,8 5.4,8 0,0 5.6,0"),
    ('{', "~3,14 1.8,13.2 1.6,10 1.4,6.8 0,5.5 1.4,4.2 1.6,1 1.8,-2.2 3,-3"),
    ('|', "0,14 0,-3"),
    ('}', "~0,14 1.2,13.2 1.4,10 1.6,6.8 3,5.5 1.6,4.2 1.4,1 1.2,-2.2 0,-3"),
    ('~', "~0,4.6 1.6,6.2 3.6,5.4 5.4,4.6 7,6.2"),
    ('°', "o1.8,12 0.5,11.4 0,10 0.5,8.6 1.8,8 3.1,8.6 3.6,10 3.1,11.4"),
    ('±', "0,6.8 7,6.8; 3.5,10.3 3.5,3.3; 0,0 7,0"),
    ('²', "~0.1,10.9 0.8,11.8 2,12 3.2,11.6 3.6,10.4 3,9.2 0,6; 0,6 3.8,6"),
    ('µ', "0,8 0,-4; ~0,3 0.6,0.8 2.6,0 4.6,0.8 5.6,2.8; 5.6,8 5.6,0"),
    ('×', "0,9 6,2; 6,9 0,2"),
    ('ß', "0,0 0,9.6; ~0,9.6 0.9,11.5 2.8,12 4.8,11.2 5.2,9.4 4.2,7.6 3.2,6.8; ~3.2,6.8 5.4,5.6 6.2,3.2 5.2,0.8 2.4,0.2"),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_printable_ascii_character_has_strokes_that_parse() {
        for character in ' '..='~' {
            assert!(GLYPHS.iter().any(|(known, _)| *known == character), "{character:?} is missing");
        }
        for (character, strokes) in GLYPHS.iter().copied().chain(ACCENTS.map(|(accent, _)| ('´', accent))) {
            for stroke in strokes.split(';').map(str::trim).filter(|stroke| !stroke.is_empty()) {
                let stroke = stroke.trim_start_matches(['~', 'o']);
                assert_eq!(
                    points(stroke).len(),
                    stroke.split_whitespace().count(),
                    "{character:?}: {stroke}"
                );
            }
        }
    }

    #[test]
    fn lettering_puts_glyphs_side_by_side() {
        let (segments, width) = lettering("HI");
        let right = segments.iter().flatten().map(|end| end.x).fold(0.0, f64::max);
        assert_eq!((segments.len(), right), (6, width));
        assert_eq!(width, 8.0 + GAP + 4.0);
        assert_eq!(lettering("").1, 0.0);
    }

    #[test]
    fn glyphs_keep_to_their_lines_and_differ() {
        let mut seen = BTreeMap::new();
        for (character, glyph) in font() {
            for end in glyph.segments.iter().flatten() {
                assert!(
                    (-4.5..17.0).contains(&end.y) && (-0.7..11.0).contains(&end.x),
                    "{character:?}: {end}"
                );
            }
            let ink = format!("{:?}", glyph.segments);
            assert_eq!(seen.insert(ink, character), None, "{character:?} looks like another one");
        }
        assert!(seen.len() > 130, "{} characters", seen.len());
        assert_eq!(glyph('Ä').segments.len(), glyph('A').segments.len() + 2);
        assert_eq!(glyph('\u{4e2d}').segments.len(), 4, "what is missing is a box");
    }
}
