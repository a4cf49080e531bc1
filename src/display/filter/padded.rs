//! A plane of numbers with a margin, which windows of pixels read without bounds of their own.

/// A plane of numbers with `margin` copies of its border on every side, so that windows need no
/// bounds of their own.
pub(super) struct Padded {
    values: Vec<f32>,
    /// Numbers from one row to the next.
    stride: usize,
}

impl Padded {
    /// Pads a plane of `width` columns; on the right as far as whole groups of `lanes` need.
    pub(super) fn new(plane: &[f32], width: usize, margin: usize, lanes: usize) -> Self {
        let stride = width.next_multiple_of(lanes) + 2 * margin;
        let height = plane.len() / width;
        let mut values = Vec::with_capacity(stride * (height + 2 * margin));
        for row in 0..height + 2 * margin {
            let row = row.saturating_sub(margin).min(height - 1);
            let line = &plane[row * width..][..width];
            values.extend(std::iter::repeat_n(line[0], margin));
            values.extend(line);
            values.resize(values.len() + stride - margin - width, line[width - 1]);
        }
        Self { values, stride }
    }

    /// `count` numbers from a column and row of the padded plane on.
    pub(super) fn run(&self, column: usize, row: usize, count: usize) -> &[f32] {
        &self.values[row * self.stride + column..][..count]
    }
}

/// NaN is a miss.
pub(super) fn miss_if_unknown(mm: f32) -> f32 {
    if mm.is_nan() { f32::INFINITY } else { mm }
}
