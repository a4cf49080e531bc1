//! Small pictures of a volume, one for each preset, and the sheet that shows them all.
//!
//! What it is: the scene of a thumbnail, shared by the command line and HTTP, and
//! [`contact_sheet`], which arranges rendered thumbnails with their names in one frame. What it is
//! not: rendering. Sizes in pixels.

use relief_display::{DisplaySettings, Frame, Layout, LayoutError, Pixels};
use relief_render::{Scene, SceneError, SceneFile, Subject, TextMask, text_margin_px, text_mask};
use relief_volume::{Orbit, Preset};

/// Width and height of a thumbnail.
pub const THUMBNAIL_SIZE_PX: [u32; 2] = [160, 120];

/// From the front, a little from the left and above.
const VIEW: Orbit = Orbit { azimuth_deg: 20.0, elevation_deg: 10.0, zoom: 1.0, vertical_fov_deg: 22.0 };

/// The scene of a preset's thumbnail: layout colour, all other settings default.
///
/// # Errors
/// When a picture of this size is out of range.
pub fn thumbnail_scene(
    preset: &Preset,
    subject: &Subject<'_>,
    size_px: [u32; 2],
) -> Result<Scene, SceneError> {
    let display = DisplaySettings { layout: Layout::Color, ..DisplaySettings::default() };
    let file = SceneFile::default().with_preset(preset.name).with_size(size_px).with_display(display);
    file.resolve_for(subject, &VIEW)
}

/// Pixels between cells.
const GAP: usize = 8;
/// Height of the capitals of a name.
const CAPITALS_PX: u32 = 10;
/// Height of the line below a thumbnail that holds its name: that of its mask.
const LINE: usize = (CAPITALS_PX + 2 * text_margin_px(CAPITALS_PX)) as usize;
const GROUND: [u8; 3] = [24, 28, 33];
const TEXT: [u8; 3] = [226, 232, 238];

/// A small picture with its name.
#[derive(Clone, Copy, Debug)]
pub struct Thumbnail<'a> {
    /// Text below the thumbnail.
    pub name: &'a str,
    /// Width and height.
    pub size_px: [u32; 2],
    /// Rows from the top; the fourth byte counts for nothing.
    pub color_rgba: &'a [[u8; 4]],
}

/// Thumbnails of equal size in rows of `columns`, each above its name.
///
/// # Errors
/// When there are no thumbnails, their sizes differ, or the sheet is larger than any frame.
pub fn contact_sheet(thumbnails: &[Thumbnail<'_>], columns: usize) -> Result<Frame, LayoutError> {
    let size_px = thumbnails.first().map_or([0, 0], |thumbnail| thumbnail.size_px);
    let [cell_width, cell_height] = size_px.map(|side| side as usize);
    let columns = columns.clamp(1, thumbnails.len().max(1));
    let rows = thumbnails.len().div_ceil(columns);
    let width = columns * (cell_width + GAP) + GAP;
    let height = rows * (cell_height + LINE + GAP) + GAP;
    let side = |pixels: usize| u32::try_from(pixels).unwrap_or(u32::MAX);
    let sheet_px = [side(width), side(height)];
    // Checked before the pixels are allocated: the limits of a frame.
    if thumbnails.is_empty() || sheet_px.iter().any(|side| *side > relief_display::MAX_FRAME_SIDE_PX) {
        return Err(LayoutError::Size { what: "a contact sheet", size_px: sheet_px });
    }
    let mut sheet = Sheet { width, rgb: GROUND.repeat(width * height) };
    for (index, thumbnail) in thumbnails.iter().enumerate() {
        let expected = cell_width * cell_height;
        if thumbnail.size_px != size_px || thumbnail.color_rgba.len() != expected {
            let (found, size_px) = (thumbnail.color_rgba.len(), thumbnail.size_px);
            return Err(LayoutError::PixelCount { what: "a thumbnail", size_px, found, expected });
        }
        let left = GAP + index % columns * (cell_width + GAP);
        let top = GAP + index / columns * (cell_height + LINE + GAP);
        sheet.paste(thumbnail, [left, top]);
        sheet.write(thumbnail.name, [left, top + cell_height], cell_width);
    }
    Frame::new(sheet_px, Pixels::Rgb8(sheet.rgb))
}

/// Rows of red, green and blue from the top left.
struct Sheet {
    width: usize,
    rgb: Vec<u8>,
}

impl Sheet {
    fn put(&mut self, [x, y]: [usize; 2], color: [u8; 3]) {
        let at = 3 * (y * self.width + x);
        self.rgb[at..at + 3].copy_from_slice(&color);
    }

    fn paste(&mut self, thumbnail: &Thumbnail<'_>, [left, top]: [usize; 2]) {
        let width = thumbnail.size_px[0] as usize;
        for (i, &[r, g, b, _]) in thumbnail.color_rgba.iter().enumerate() {
            self.put([left + i % width, top + i / width], [r, g, b]);
        }
    }

    /// Writes as many whole letters as fit into `width`.
    fn write(&mut self, text: &str, [left, top]: [usize; 2], width: usize) {
        let TextMask { size_px, coverage } = fitting(text, width);
        for (i, &share) in coverage.iter().enumerate() {
            let (x, y) = (i % size_px[0] as usize, i / size_px[0] as usize);
            let mix = |ground: u8, ink: u8| {
                let sum = u32::from(ground) * u32::from(255 - share) + u32::from(ink) * u32::from(share);
                (sum / 255) as u8
            };
            self.put([left + x, top + y], std::array::from_fn(|channel| mix(GROUND[channel], TEXT[channel])));
        }
    }
}

/// The mask of the longest beginning of a text that fits into `width` pixels.
fn fitting(text: &str, width: usize) -> TextMask {
    let ends = text.char_indices().map(|(at, letter)| at + letter.len_utf8()).rev();
    let masks = ends.map(|end| text_mask(&text[..end], CAPITALS_PX));
    let fits = |mask: &TextMask| mask.size_px[0] as usize <= width;
    masks.into_iter().find(fits).unwrap_or(TextMask { size_px: [0, 0], coverage: Vec::new() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use relief_volume::{Grid, PRESETS};

    fn grid() -> Grid {
        Grid::axis_aligned([64, 64, 32], [0.8, 0.8, 1.0], [0.0; 3]).unwrap()
    }

    fn plain([width, height]: [u32; 2], color: [u8; 4]) -> Vec<[u8; 4]> {
        vec![color; (width * height) as usize]
    }

    #[test]
    fn every_preset_has_a_small_scene_in_its_own_mode_and_light() {
        for preset in PRESETS {
            let scene = thumbnail_scene(preset, &Subject::of_grid(&grid()), THUMBNAIL_SIZE_PX).unwrap();
            assert_eq!(scene.request.size_px, THUMBNAIL_SIZE_PX);
            assert_eq!(scene.request.transfer, preset.transfer());
            assert_eq!(scene.request.shading.ambient, preset.light[0], "{}", preset.name);
            assert_eq!(scene.display.layout, Layout::Color);
        }
    }

    #[test]
    fn a_sheet_has_every_thumbnail_whole_above_its_name() {
        let colors = [[200, 0, 0, 255], [0, 200, 0, 255], [0, 0, 200, 255]];
        let pictures = colors.map(|color| plain([40, 20], color));
        let named: Vec<_> = ["bone", "x-ray", "lung"]
            .into_iter()
            .zip(&pictures)
            .map(|(name, color_rgba)| Thumbnail { name, size_px: [40, 20], color_rgba })
            .collect();
        let sheet = contact_sheet(&named, 2).unwrap();
        assert_eq!(sheet.size_px(), [2 * 48 + 8, 2 * (20 + 20 + 8) + 8]);
        let Pixels::Rgb8(rgb) = sheet.pixels() else { panic!("colour") };
        let count = |color: [u8; 3]| rgb.chunks(3).filter(|pixel| **pixel == color).count();
        for [r, g, b, _] in colors {
            assert_eq!(count([r, g, b]), 40 * 20);
        }
        for (index, thumbnail) in named.iter().enumerate() {
            let [left, top] = [8 + index % 2 * 48, 8 + 20 + index / 2 * 48];
            let ink = |x: usize, y: usize| rgb[3 * ((top + y) * 104 + left + x)] > GROUND[0];
            let inked = (0..16).any(|y| (0..40).any(|x| ink(x, y)));
            assert!(inked, "{} is written below its picture", thumbnail.name);
        }
    }

    #[test]
    fn sheets_that_cannot_be_are_refused() {
        assert!(contact_sheet(&[], 4).is_err());
        let pictures = [[8, 8], [9, 8], [200, 1]].map(|size_px| (size_px, plain(size_px, [1, 2, 3, 255])));
        let [small, large, wide] = pictures.each_ref().map(|(size_px, color_rgba)| Thumbnail {
            name: "a",
            size_px: *size_px,
            color_rgba,
        });
        let refused = contact_sheet(&[small, large], 2).unwrap_err();
        assert!(refused.to_string().contains("thumbnail"), "{refused}");
        let wide = [wide; 90];
        assert!(contact_sheet(&wide, 90).is_err());
    }
}
