//! PNG files of views: quilts and pairs with their layout written into them, and wiggles as
//! animations.
//!
//! A text chunk `relief-layout` contains the layout's name, since a quilt looks like any other
//! picture to a program. A wiggle is an animated PNG (APNG, the third edition of the PNG
//! specification) that plays the views forwards and backwards without end; programs without
//! animations show the leftmost view.

use std::io::Cursor;

use super::EncodeError;
use crate::layout::Pixels;
use crate::layout::error::LayoutError;
use crate::layout::table::Layout;
use crate::views::{LensPanel, Views};

/// The keyword of the text chunk.
pub(crate) const LAYOUT_KEYWORD: &str = "relief-layout";

/// The time of each picture of a wiggle: one way takes half a second.
const STEP_MS: u16 = 60;

/// The most memory that decoding an animation may take beside its pictures.
const MAX_DECODED_BYTES: usize = 1 << 28;

/// A PNG of views in their layout, animated for `wiggle`; `panel` is for layouts of lenses.
///
/// # Errors
/// When the views are not those of the layout, their frame is too large, or the encoder fails.
pub fn encode_views(layout: Layout, views: &Views, panel: &LensPanel) -> Result<Vec<u8>, EncodeError> {
    if layout == Layout::Wiggle {
        return wiggle(views);
    }
    let frame = layout.frame_of_views(views, panel)?;
    let mut file = Vec::new();
    let mut writer = encoder(&mut file, frame.size_px(), layout)?.write_header()?;
    let Pixels::Rgb8(samples) = frame.pixels() else { return Err(LayoutError::Animation.into()) };
    writer.write_image_data(samples)?;
    writer.finish()?;
    Ok(file)
}

fn wiggle(views: &Views) -> Result<Vec<u8>, EncodeError> {
    let (layout, pictures) = (Layout::Wiggle, views.pictures());
    let (Ok(count), Some(inner)) = (u32::try_from(pictures.len()), pictures.get(1..pictures.len() - 1))
    else {
        return Err(LayoutError::ViewCount { layout, found: pictures.len() }.into());
    };
    let mut file = Vec::new();
    let mut encoder = encoder(&mut file, views.size_px(), layout)?;
    encoder.set_animated(2 * count - 2, 0)?;
    encoder.set_frame_delay(STEP_MS, 1000)?;
    let mut writer = encoder.write_header()?;
    for picture in pictures.iter().chain(inner.iter().rev()) {
        writer.write_image_data(picture.as_flattened())?;
    }
    writer.finish()?;
    Ok(file)
}

fn encoder(
    file: &mut Vec<u8>,
    [width, height]: [u32; 2],
    layout: Layout,
) -> Result<png::Encoder<'static, &mut Vec<u8>>, EncodeError> {
    let mut encoder = png::Encoder::new(file, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::Fast);
    encoder.set_filter(png::Filter::Sub);
    encoder.add_text_chunk(LAYOUT_KEYWORD.to_owned(), layout.name().into_owned())?;
    Ok(encoder)
}

/// The views of an animated PNG that [`encode_views`] wrote.
///
/// # Errors
/// When the file is damaged, is no animation of whole RGB pictures to and fro, or is too large.
pub fn decode_wiggle(file: &[u8]) -> Result<Views, EncodeError> {
    let mut reader = decoder(file).read_info()?;
    let info = reader.info();
    let size_px = [info.width, info.height];
    let frames = info.animation_control.map_or(0, |control| control.num_frames);
    let is_rgb = info.color_type == png::ColorType::Rgb && info.bit_depth == png::BitDepth::Eight;
    if frames < 2 || !frames.is_multiple_of(2) || !is_rgb {
        return Err(EncodeError::NoWiggle);
    }
    let count = frames as usize / 2 + 1;
    crate::views::check_size(size_px, count)?;
    let mut pictures = Vec::new();
    for _ in 0..count {
        let mut samples = vec![0; 3 * size_px[0] as usize * size_px[1] as usize];
        let read = reader.next_frame(&mut samples)?;
        if [read.width, read.height] != size_px {
            return Err(EncodeError::NoWiggle);
        }
        pictures.push(samples.as_chunks::<3>().0.to_vec());
    }
    Ok(Views::new(size_px, pictures)?)
}

/// A decoder within the limits. It leaves profiles of colour packed: nothing here needs them.
fn decoder(file: &[u8]) -> png::Decoder<Cursor<&[u8]>> {
    let limits = png::Limits { bytes: MAX_DECODED_BYTES };
    let mut decoder = png::Decoder::new_with_limits(Cursor::new(file), limits);
    decoder.set_ignore_iccp_chunk(true);
    decoder
}

/// The number of pictures in the header of an animated PNG, and the layout that is written into it, as
/// far as the file has them before its pixels.
pub(crate) fn written_layout(file: &[u8]) -> Option<(Layout, u32)> {
    let reader = decoder(file).read_info().ok()?;
    let info = reader.info();
    let texts = &info.uncompressed_latin1_text;
    let layout = texts.iter().find(|text| text.keyword == LAYOUT_KEYWORD)?.text.parse().ok()?;
    Some((layout, info.animation_control.map_or(0, |control| control.num_frames)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn views(count: u8) -> Views {
        let picture = |view: u8| (0..15).map(|i| [view, i, 255 - i]).collect();
        Views::new([5, 3], (0..count).map(picture).collect()).unwrap()
    }

    #[test]
    fn a_wiggle_goes_to_and_fro_and_comes_back_as_its_views() {
        for count in [2, 3, 9] {
            let file = encode_views(Layout::Wiggle, &views(count), &LensPanel::default()).unwrap();
            assert_eq!(decode_wiggle(&file).unwrap(), views(count));
            assert_eq!(written_layout(&file), Some((Layout::Wiggle, 2 * u32::from(count) - 2)));
            for cut in (0..file.len()).step_by(7) {
                assert!(decode_wiggle(&file[..cut]).is_err() || cut > file.len() / 2, "cut at {cut}");
            }
        }
        let one = Views::new([5, 3], vec![vec![[0; 3]; 15]]).unwrap();
        assert!(encode_views(Layout::Wiggle, &one, &LensPanel::default()).is_err());
    }

    #[test]
    fn a_still_file_has_its_layout_written_into_it() {
        let layout = "views-3x1".parse().unwrap();
        let file = encode_views(layout, &views(3), &LensPanel::default()).unwrap();
        assert_eq!(written_layout(&file), Some((layout, 0)));
        assert!(matches!(decode_wiggle(&file), Err(EncodeError::NoWiggle)));
        assert!(matches!(
            encode_views(layout, &views(4), &LensPanel::default()),
            Err(EncodeError::Layout(_))
        ));
    }
}
