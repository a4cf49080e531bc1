//! The header against public vectors, known-wrong writers, and a checksum computed bit by bit.
#![expect(clippy::unwrap_used, reason = "a test fails by panicking, its helpers too")]

use proptest::prelude::*;
use relief_display::{ContentType, ExtendedPart, Header, HeaderPart, HeaderProblem, HeaderReading};

/// Line 0 of one public writer.
const SIGNAGE: &str = "F10140800000C42DD3AFF2140000000000000000000000000000000036958221";

/// The pixels of line 0 whose top blue bit that header sets.
const SIGNAGE_PIXELS: [usize; 45] = [
    0, 2, 4, 6, 14, 30, 34, 48, 96, 98, 106, 116, 120, 122, 126, 128, 130, 134, 140, 142, 144, 148, 152, 154,
    156, 158, 160, 162, 164, 166, 172, 182, 186, 452, 454, 458, 460, 464, 470, 474, 478, 480, 492, 500, 510,
];

fn bytes(hex: &str) -> Vec<u8> {
    let digits: Vec<char> = hex.chars().filter(|c| !c.is_whitespace()).collect();
    digits.chunks(2).map(|pair| u8::from_str_radix(&pair.iter().collect::<String>(), 16).unwrap()).collect()
}

/// The extended part of a vector written like `F2 14 00*15 36958221`.
fn extended(start: &str, zeros: usize, end: &str) -> Vec<u8> {
    [bytes(start), vec![0; zeros], bytes(end)].concat()
}

/// CRC-32 by long division: polynomial 0x04C11DB7, no initial value, no reflection, no final xor.
fn crc_bit_by_bit(data: &[u8]) -> u32 {
    let mut remainder = 0u32;
    for bit in data.iter().flat_map(|byte| (0..8).rev().map(move |y| u32::from(byte >> y & 1))) {
        let top = remainder >> 31 ^ bit;
        remainder = remainder << 1 ^ if top == 1 { 0x04C1_1DB7 } else { 0 };
    }
    remainder
}

/// Line 0 of a frame with these header bytes over a colour, written by a loop of its own.
fn line_with(header: &[u8], width: usize, color: [u8; 3]) -> Vec<u8> {
    let mut line = color.repeat(width);
    for (n, byte) in header.iter().enumerate() {
        for y in 0..8 {
            let x = 16 * n + 2 * (7 - y);
            if x < width {
                line[3 * x + 2] = line[3 * x + 2] & 0x7F | (byte >> y & 1) << 7;
            }
        }
    }
    line
}

fn defaults(content: ContentType, extended: Option<ExtendedPart>) -> Header {
    Header { content, factor: 64, offset: 128, use_factor: false, use_offset: false, extended }
}

#[test]
fn the_independent_checksum_has_the_published_check_value() {
    assert_eq!(crc_bit_by_bit(b"123456789"), 0x89A1_897F);
}

#[test]
fn public_vectors_decode_and_encode() {
    let removed = extended("F2149A", 15, "6BF6C689");
    let two_d = extended("F21400", 15, "36958221");
    let signage = bytes("F10140800000C42DD3AF");
    for (vector, header) in [
        (signage.clone(), defaults(ContentType::Signage, None)),
        (bytes("F102408000001F3A7B38"), defaults(ContentType::Movie, None)),
        (
            bytes("F10100000000F968007A"),
            Header { factor: 0, offset: 0, ..defaults(ContentType::Signage, None) },
        ),
        (bytes(SIGNAGE), defaults(ContentType::Signage, Some(ExtendedPart::TwoDPlusZ))),
        ([signage.clone(), two_d].concat(), defaults(ContentType::Signage, Some(ExtendedPart::TwoDPlusZ))),
        ([signage, removed].concat(), defaults(ContentType::Signage, Some(ExtendedPart::DeclipseRemoved))),
    ] {
        assert_eq!(Header::from_bytes(&vector), Ok(header), "{vector:02X?}");
        assert_eq!(header.to_bytes(), vector);
    }
}

/// The checksum of this public vector is right, so its fields and its errors are reported.
#[test]
fn a_public_vector_with_a_reserved_bit_decodes_with_the_problem_named() {
    let stereo = HeaderReading::of_bytes(&bytes("F10140801000D47C48BC"));
    assert_eq!(stereo.header, Some(defaults(ContentType::Signage, None)));
    assert_eq!(stereo.problems, [HeaderProblem::Reserved { byte: 4, found: 0x10, reserved: 0x3F }]);
}

/// One public writer fills H14 to H17, and only in one way.
#[test]
fn the_public_dimenco_vector_is_accepted_and_its_likes_are_not() {
    let base = bytes("F10140800000C42DD3AF");
    let dimenco = extended("F2140000003C021C", 10, "880712DD");
    let reading = HeaderReading::of_bytes(&[base.clone(), dimenco.clone()].concat());
    assert_eq!(reading.header, Some(defaults(ContentType::Signage, Some(ExtendedPart::TwoDPlusZ))));
    assert_eq!(reading.problems, []);
    let mut other = dimenco;
    other[5] = 0x3D;
    let reading = HeaderReading::of_bytes(&[base, other].concat());
    assert!(reading.problems.contains(&HeaderProblem::Reserved { byte: 15, found: 0x3D, reserved: 0xFF }));
}

#[test]
fn the_public_header_sets_exactly_these_45_pixels() {
    let line = line_with(&bytes(SIGNAGE), 960, [0; 3]);
    let set: Vec<usize> = (0..960).filter(|x| line[3 * x + 2] >= 128).collect();
    assert_eq!(set, SIGNAGE_PIXELS);
    let reading = HeaderReading::of_line(&line);
    assert_eq!((reading.bytes, reading.problems), (bytes(SIGNAGE), vec![]));
}

#[test]
fn the_threshold_is_the_top_bit_whatever_the_writer_made_of_the_rest() {
    for (zero, one) in [(0, 255), (0, 128), (127, 128), (127, 255)] {
        let mut line = vec![77; 3 * 960];
        for x in (0..960).step_by(2) {
            line[3 * x + 2] = if SIGNAGE_PIXELS.contains(&x) { one } else { zero };
        }
        assert_eq!(HeaderReading::of_line(&line).bytes, bytes(SIGNAGE));
    }
}

/// A Unity shader writes 0x35 where 0x36 belongs and stops before column 494.
#[test]
fn a_cut_header_with_a_wrong_checksum_is_refused() {
    let mut wrong = bytes(SIGNAGE);
    wrong[28] = 0x35;
    let mut line = line_with(&wrong, 960, [0; 3]);
    line[3 * 494..].fill(0);
    let expected =
        HeaderProblem::Crc { part: HeaderPart::Extended, found: 0x3595_8200, expected: 0x3695_8221 };
    assert_eq!(HeaderReading::of_line(&line).problems, [expected]);
    assert_eq!(expected.to_string(), "the CRC-32 of H10 to H27 is 0x35958200, expected 0x36958221");
    for cut in 11..32 {
        let reading = HeaderReading::of_bytes(&bytes(SIGNAGE)[..cut]);
        assert_eq!(reading.problems, [HeaderProblem::Length { found: cut, expected: 32 }]);
    }
    for cut in 0..10 {
        let problem = HeaderProblem::Length { found: cut, expected: 10 };
        assert_eq!(Header::from_bytes(&bytes(SIGNAGE)[..cut]), Err(vec![problem]));
    }
    // A picture too narrow for the extended part cuts it, too.
    let narrow = HeaderReading::of_line(&line_with(&bytes(SIGNAGE), 494, [0; 3]));
    assert_eq!(narrow.problems, [HeaderProblem::Length { found: 30, expected: 32 }]);
}

/// A writer puts 0xA0 into H18 and the checksum of 0xC0.
#[test]
fn an_extended_part_with_a_stray_byte_is_refused() {
    let vector = |byte: &str| {
        [bytes("F10140800000C42DD3AF"), bytes("F214"), vec![0; 6], bytes(byte), vec![0; 9], bytes("F6486EF6")]
            .concat()
    };
    let problems = Header::from_bytes(&vector("A0")).unwrap_err();
    let expected = crc_bit_by_bit(&vector("A0")[10..28]);
    assert_eq!(
        problems,
        [
            HeaderProblem::Reserved { byte: 18, found: 0xA0, reserved: 0xFF },
            HeaderProblem::Crc { part: HeaderPart::Extended, found: 0xF648_6EF6, expected },
        ]
    );
    let with_right_checksum = Header::from_bytes(&vector("C0")).unwrap_err();
    assert_eq!(with_right_checksum, [HeaderProblem::Reserved { byte: 18, found: 0xC0, reserved: 0xFF }]);
}

#[test]
fn select_values_in_the_low_bits_are_refused() {
    for select in 1..=3 {
        let mut wrong = vec![0xF1, 1, 64, 128, select, 0];
        wrong.extend(crc_bit_by_bit(&wrong).to_be_bytes());
        let problem = HeaderProblem::Reserved { byte: 4, found: select, reserved: 0x3F };
        assert_eq!(Header::from_bytes(&wrong), Err(vec![problem]));
    }
}

#[test]
fn other_wrong_bytes_are_named() {
    let with = |index: usize, value: u8| {
        let mut wrong = bytes(SIGNAGE);
        wrong[index] = value;
        let base = crc_bit_by_bit(&wrong[..6]);
        wrong[6..10].copy_from_slice(&base.to_be_bytes());
        let extended = crc_bit_by_bit(&wrong[10..28]);
        wrong[28..].copy_from_slice(&extended.to_be_bytes());
        Header::from_bytes(&wrong).unwrap_err()
    };
    assert_eq!(with(0, 0x12), [HeaderProblem::Magic { found: 0x12 }]);
    assert_eq!(with(1, 6), [HeaderProblem::UnknownContent { found: 6 }]);
    assert_eq!(with(5, 9), [HeaderProblem::Reserved { byte: 5, found: 9, reserved: 0xFF }]);
    assert_eq!(with(10, 0xF3), [HeaderProblem::ExtendedStart { byte: 10, found: 0xF3, expected: 0xF2 }]);
    assert_eq!(with(11, 0x15), [HeaderProblem::ExtendedStart { byte: 11, found: 0x15, expected: 0x14 }]);
    assert_eq!(with(12, 0x9B), [HeaderProblem::UnknownExtended { found: 0x9B }]);
    let long = [bytes(SIGNAGE), vec![0]].concat();
    assert_eq!(Header::from_bytes(&long), Err(vec![HeaderProblem::Length { found: 33, expected: 32 }]));
}

#[test]
fn every_single_bit_flip_is_detected() {
    for flipped in 0..256 {
        let mut header = bytes(SIGNAGE);
        header[flipped / 8] ^= 1 << (flipped % 8);
        assert!(Header::from_bytes(&header).is_err(), "bit {flipped} of the bytes");
        let line = HeaderReading::of_line(&line_with(&header, 960, [10, 20, 30]));
        assert_ne!(line.problems, [], "bit {flipped} of the line");
    }
}

/// Behind a header of ten bytes the same pixels carry the picture, whose bits mean nothing.
#[test]
fn ten_bytes_are_read_alone_where_no_extended_part_follows() {
    for color in [[0; 3], [255; 3], [9, 8, 200]] {
        let reading = HeaderReading::of_line(&line_with(&bytes("F10140800000C42DD3AF"), 960, color));
        assert_eq!((reading.bytes.len(), reading.problems), (10, vec![]), "{color:?}");
    }
}

fn any_header() -> impl Strategy<Value = Header> {
    let content = prop::sample::select(&ContentType::ALL[..]);
    let extended = prop::option::of(prop::sample::select(&ExtendedPart::ALL[..]));
    (content, any::<u8>(), any::<u8>(), any::<bool>(), any::<bool>(), extended).prop_map(
        |(content, factor, offset, use_factor, use_offset, extended)| Header {
            content,
            factor,
            offset,
            use_factor,
            use_offset,
            extended,
        },
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(1000))]

    #[test]
    fn every_header_comes_back(header in any_header()) {
        prop_assert_eq!(Header::from_bytes(&header.to_bytes()), Ok(header));
    }

    #[test]
    fn the_bytes_are_those_of_the_format(header in any_header()) {
        let bytes = header.to_bytes();
        let select = u8::from(header.use_factor) << 7 | u8::from(header.use_offset) << 6;
        let content = ContentType::ALL.iter().position(|content| *content == header.content).unwrap();
        prop_assert_eq!(&bytes[..6], [0xF1, content as u8, header.factor, header.offset, select, 0]);
        prop_assert_eq!(&bytes[6..10], crc_bit_by_bit(&bytes[..6]).to_be_bytes());
        if header.extended.is_some() {
            prop_assert_eq!(&bytes[28..], crc_bit_by_bit(&bytes[10..28]).to_be_bytes());
        }
    }

    #[test]
    fn any_bytes_are_read_without_panic_and_only_headers_pass(noise in prop::collection::vec(any::<u8>(), 0..70)) {
        if let Ok(header) = Header::from_bytes(&noise) {
            prop_assert_eq!(header.to_bytes(), noise.clone());
        }
        let _ = HeaderReading::of_line(&noise);
    }
}
