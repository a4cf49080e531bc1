//! JPEG by discrete cosine transform with more than 8 bits: one component, Huffman codes,
//! sequential or progressive.
//!
//! DICOM's extended process 4 (and the retired spectral selection and full progression) store 12
//! bits per sample, which the decoder behind dicom-rs does not read. Names and procedures follow
//! ITU-T T.81; lossless, hierarchical and arithmetic coding are not here.
//!
//! Coefficients of the whole image are kept until all scans are read, since progressive scans
//! refine them.

use super::codestream;
use super::entropy::{Bits, Huffman, JpegFault, Part};

/// Coefficients of an 8 x 8 block, row by row.
type Block = [i32; 64];

/// Zigzag order: where the k-th coefficient of a scan lies in a block (T.81 figure 5).
const ZIGZAG: [u8; 64] = [
    0, 1, 8, 16, 9, 2, 3, 10, 17, 24, 32, 25, 18, 11, 4, 5, 12, 19, 26, 33, 40, 48, 41, 34, 27, 20, 13, 6, 7,
    14, 21, 28, 35, 42, 49, 56, 57, 50, 43, 36, 29, 22, 15, 23, 30, 37, 44, 51, 58, 59, 52, 45, 38, 31, 39,
    46, 53, 60, 61, 54, 47, 55, 62, 63,
];

/// The most scans of an image. Full progression of 12 bits needs a few dozen; each scan visits all
/// blocks, and an empty one takes a dozen bytes, so that without a limit a small file could keep a
/// thread busy for hours.
const MOST_SCANS: usize = 1000;

/// Decodes an image of `width` x `height` samples of `precision` bits.
///
/// # Errors
/// When the codestream is damaged, cut short, coded in another way, or has more than [`MOST_SCANS`]
/// scans.
pub(super) fn decode(
    data: &[u8],
    width: usize,
    height: usize,
    precision: u32,
) -> Result<Vec<u16>, JpegFault> {
    if !(2..=12).contains(&precision) {
        return Err(JpegFault::Precision(precision));
    }
    let mut image = Image::new(width, height);
    let mut tables = Tables::default();
    let mut rest = data.get(2..).unwrap_or_default();
    let mut scans = 0;
    while let Some((marker, segment, behind)) = codestream::segment(rest) {
        rest = behind;
        match marker {
            0xC4 => tables.define_huffman(segment)?,
            0xDB => tables.define_quantization(segment)?,
            0xDD => tables.define_restart_interval(segment)?,
            0xC2 => image.is_progressive = true,
            0xDA => {
                scans += 1;
                if scans > MOST_SCANS {
                    return Err(JpegFault::TooManyScans(MOST_SCANS));
                }
                rest = image.read_scan(&tables, segment, behind)?;
            }
            0xD9 => break,
            _ => {}
        }
    }
    if scans == 0 {
        return Err(JpegFault::NoScan);
    }
    Ok(image.samples(&tables.quantization[usize::from(image.quantization)], precision))
}

/// Tables in force; later definitions replace earlier ones.
#[derive(Default)]
struct Tables {
    quantization: [Vec<u16>; 4],
    dc: [Huffman; 4],
    ac: [Huffman; 4],
    restart_interval: usize,
}

impl Tables {
    fn define_quantization(&mut self, mut segment: &[u8]) -> Result<(), JpegFault> {
        while let Some((&head, rest)) = segment.split_first() {
            let bytes = if head >> 4 == 0 { 1 } else { 2 };
            let (values, behind) =
                rest.split_at_checked(64 * bytes).ok_or(JpegFault::CutShort(Part::QuantizationTable))?;
            let value = |pair: &[u8]| pair.iter().fold(0, |value, &byte| value << 8 | u16::from(byte));
            *table(&mut self.quantization, head & 15)? = values.chunks(bytes).map(value).collect();
            segment = behind;
        }
        Ok(())
    }

    fn define_huffman(&mut self, mut segment: &[u8]) -> Result<(), JpegFault> {
        while let Some((&head, rest)) = segment.split_first() {
            let (counts, rest) = rest.split_at_checked(16).ok_or(JpegFault::CutShort(Part::HuffmanTable))?;
            let total = counts.iter().map(|&count| usize::from(count)).sum();
            let (symbols, behind) =
                rest.split_at_checked(total).ok_or(JpegFault::CutShort(Part::HuffmanTable))?;
            let class = if head >> 4 == 0 { &mut self.dc } else { &mut self.ac };
            *table(class, head & 15)? = Huffman::new(counts, symbols)?;
            segment = behind;
        }
        Ok(())
    }

    fn define_restart_interval(&mut self, segment: &[u8]) -> Result<(), JpegFault> {
        let interval = segment.first_chunk::<2>().ok_or(JpegFault::CutShort(Part::RestartInterval))?;
        self.restart_interval = u16::from_be_bytes(*interval).into();
        Ok(())
    }
}

fn table<T>(tables: &mut [T; 4], index: u8) -> Result<&mut T, JpegFault> {
    tables.get_mut(usize::from(index)).ok_or(JpegFault::Table(index))
}

/// The parameters of a scan (T.81 B.2.3).
struct Scan<'a> {
    dc: &'a Huffman,
    ac: &'a Huffman,
    first: usize,
    last: usize,
    /// Bits of precision that earlier scans have delivered (0 for the first), and that remain below
    /// this one.
    high: u8,
    low: u8,
}

/// Coefficients, quantized.
struct Image {
    width: usize,
    height: usize,
    blocks: Vec<Block>,
    is_progressive: bool,
    quantization: u8,
}

impl Image {
    fn new(width: usize, height: usize) -> Self {
        let blocks = vec![[0; 64]; width.div_ceil(8) * height.div_ceil(8)];
        Self { width, height, blocks, is_progressive: false, quantization: 0 }
    }

    /// Reads a scan; returns the bytes from the marker that ends it.
    fn read_scan<'a>(
        &mut self,
        tables: &Tables,
        header: &[u8],
        data: &'a [u8],
    ) -> Result<&'a [u8], JpegFault> {
        let &[1, _, selectors, first, last, approximation, ..] = header else {
            return Err(JpegFault::Components(header.first().copied().unwrap_or(0)));
        };
        let (first, last) = if self.is_progressive { (first.into(), last.into()) } else { (0, 63) };
        let (high, low) = if self.is_progressive { (approximation >> 4, approximation & 15) } else { (0, 0) };
        if first > last || last > 63 || (self.is_progressive && first == 0 && last > 0) || low > 13 {
            return Err(JpegFault::Coefficients { first, last, low });
        }
        let select = |index: u8| usize::from(index & 3);
        let (dc, ac) = (&tables.dc[select(selectors >> 4)], &tables.ac[select(selectors)]);
        let scan = Scan { dc, ac, first, last, high, low };
        let mut bits = Bits::new(data);
        let mut state = State::default();
        for (index, block) in self.blocks.iter_mut().enumerate() {
            if tables.restart_interval > 0 && index > 0 && index % tables.restart_interval == 0 {
                bits.restart()?;
                state = State::default();
            }
            scan.read_block(&mut bits, &mut state, block)?;
        }
        Ok(bits.behind())
    }

    /// Samples by dequantization, inverse transform, level shift and clamping (T.81 A.3).
    fn samples(&self, quantization: &[u16], precision: u32) -> Vec<u16> {
        let basis = cosine_basis();
        let (level, highest) = ((1u32 << (precision - 1)) as f32, ((1u32 << precision) - 1) as f32);
        let mut samples = vec![0; self.width * self.height];
        let across = self.width.div_ceil(8);
        for (index, block) in self.blocks.iter().enumerate() {
            let (left, top) = (index % across * 8, index / across * 8);
            let values = inverse_transform(block, quantization, &basis);
            for (y, row) in values.chunks_exact(8).enumerate().take(self.height - top) {
                let columns = 8.min(self.width - left);
                let out = &mut samples[(top + y) * self.width + left..][..columns];
                for (sample, value) in out.iter_mut().zip(row) {
                    let clamped = (value + level).round().clamp(0.0, highest) as u16;
                    *sample = clamped;
                }
            }
        }
        samples
    }
}

/// The state of a scan from block to block.
#[derive(Default)]
struct State {
    /// The previous block's DC coefficient.
    prediction: i32,
    /// Blocks left in a run without further coefficients.
    end_of_band_run: u32,
}

impl Scan<'_> {
    fn read_block(&self, bits: &mut Bits<'_>, state: &mut State, block: &mut Block) -> Result<(), JpegFault> {
        let mut first = self.first;
        if first == 0 {
            self.read_dc(bits, state, block)?;
            first = 1;
        }
        match self.high {
            _ if self.last < first => Ok(()),
            0 => self.read_ac(bits, state, block, first),
            _ => self.refine_ac(bits, state, block, first),
        }
    }

    fn read_dc(&self, bits: &mut Bits<'_>, state: &mut State, block: &mut Block) -> Result<(), JpegFault> {
        if self.high > 0 {
            block[0] |= i32::from(bits.bit()?) << self.low;
            return Ok(());
        }
        let size = bits.symbol(self.dc)?;
        state.prediction = state.prediction.wrapping_add(bits.signed(size)?);
        block[0] = state.prediction << self.low;
        Ok(())
    }

    /// AC coefficients, complete or down to a bit (T.81 F.2.2.2, G.1.2.2).
    fn read_ac(
        &self,
        bits: &mut Bits<'_>,
        state: &mut State,
        block: &mut Block,
        first: usize,
    ) -> Result<(), JpegFault> {
        if state.end_of_band_run > 0 {
            state.end_of_band_run -= 1;
            return Ok(());
        }
        let mut k = first;
        while k <= self.last {
            let symbol = bits.symbol(self.ac)?;
            let (run, size) = (symbol >> 4, symbol & 15);
            if size == 0 && run < 15 {
                state.end_of_band_run = (1 << run) - 1 + bits.take(run)?;
                break;
            }
            k += usize::from(run);
            if size > 0 {
                let place = ZIGZAG.get(k).ok_or(JpegFault::Run)?;
                block[usize::from(*place)] = bits.signed(size)? << self.low;
            }
            k += 1;
        }
        Ok(())
    }

    /// One more bit of AC coefficients: known ones are refined, new ones placed between them (T.81
    /// G.1.2.3).
    fn refine_ac(
        &self,
        bits: &mut Bits<'_>,
        state: &mut State,
        block: &mut Block,
        first: usize,
    ) -> Result<(), JpegFault> {
        let one = 1i32 << self.low;
        let mut k = first;
        while k <= self.last && state.end_of_band_run == 0 {
            let symbol = bits.symbol(self.ac)?;
            let (mut run, size) = (symbol >> 4, symbol & 15);
            let mut new = 0;
            if size > 0 {
                new = if bits.bit()? { one } else { -one };
            } else if run < 15 {
                state.end_of_band_run = (1 << run) + bits.take(run)?;
                break;
            }
            while k <= self.last {
                let coefficient = &mut block[usize::from(ZIGZAG[k])];
                k += 1;
                if *coefficient != 0 {
                    refine(bits, coefficient, one)?;
                } else if run == 0 {
                    *coefficient = new;
                    break;
                } else {
                    run -= 1;
                }
            }
        }
        if state.end_of_band_run > 0 {
            for &place in ZIGZAG.get(k..=self.last).unwrap_or_default() {
                let coefficient = &mut block[usize::from(place)];
                if *coefficient != 0 {
                    refine(bits, coefficient, one)?;
                }
            }
            state.end_of_band_run -= 1;
        }
        Ok(())
    }
}

fn refine(bits: &mut Bits<'_>, coefficient: &mut i32, one: i32) -> Result<(), JpegFault> {
    if bits.bit()? && coefficient.unsigned_abs() & one.unsigned_abs() == 0 {
        *coefficient += one * coefficient.signum();
    }
    Ok(())
}

/// `basis[x][u]` = C(u)/2 cos((2x + 1) u pi / 16).
fn cosine_basis() -> [[f32; 8]; 8] {
    std::array::from_fn(|x| {
        std::array::from_fn(|u| {
            let scale = if u == 0 { std::f64::consts::FRAC_1_SQRT_2 } else { 1.0 } / 2.0;
            (scale * ((2 * x + 1) as f64 * u as f64 * std::f64::consts::PI / 16.0).cos()) as f32
        })
    })
}

/// Dequantization and the two-dimensional inverse transform, columns first.
fn inverse_transform(block: &Block, quantization: &[u16], basis: &[[f32; 8]; 8]) -> [f32; 64] {
    let mut coefficients = [0f32; 64];
    for (&place, &step) in ZIGZAG.iter().zip(quantization) {
        coefficients[usize::from(place)] = block[usize::from(place)] as f32 * f32::from(step);
    }
    let mut columns = [0f32; 64];
    for (y, u) in (0..8).flat_map(|y| (0..8).map(move |u| (y, u))) {
        columns[y * 8 + u] = (0..8).map(|v| coefficients[v * 8 + u] * basis[y][v]).sum();
    }
    let mut values = [0f32; 64];
    for (y, x) in (0..8).flat_map(|y| (0..8).map(move |x| (y, x))) {
        values[y * 8 + x] = (0..8).map(|u| columns[y * 8 + u] * basis[x][u]).sum();
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lone_dc_coefficient_is_a_flat_block() {
        let mut block = [0; 64];
        block[0] = 80;
        let values = inverse_transform(&block, &[4; 64], &cosine_basis());
        assert!(values.iter().all(|value| (value - 40.0).abs() < 1e-3), "{values:?}"); // 80 * 4 / 8
    }

    #[test]
    fn scans_are_counted() {
        // One Huffman code, `0`, for a difference of no bits; each scan is one such code and seven
        // bits of padding.
        let table = [&[0xFF, 0xC4, 0, 20, 0, 1][..], &[0; 15], &[0]].concat();
        let scan = [0xFF, 0xDA, 0, 8, 1, 1, 0, 0, 0, 0, 0x7F];
        let image = |scans| [&[0xFF, 0xD8, 0xFF, 0xC2, 0, 2][..], &table, &scan.repeat(scans)].concat();
        assert_eq!(decode(&image(MOST_SCANS), 8, 8, 12).unwrap(), vec![2048; 64]);
        let error = decode(&image(MOST_SCANS + 1), 8, 8, 12).unwrap_err();
        assert!(matches!(error, JpegFault::TooManyScans(1000)), "{error}");
    }

    #[test]
    fn damaged_codestreams_are_errors() {
        for data in [&[][..], &[0xFF, 0xD8], &[0xFF, 0xD8, 0xFF, 0xDA, 0, 8, 1, 1, 0, 0, 63, 0, 1, 2, 3]] {
            assert!(decode(data, 8, 8, 12).is_err(), "{data:?}");
        }
    }
}
