//! The number of views, and the layout of a quilt of them.

use std::fmt;
use std::str::FromStr;

/// The most views that a picture is made into.
pub const MAX_VIEWS: u32 = 128;

/// Columns and rows of quilts as Looking Glass displays have them, where these are not the usual
/// ones.
const QUILTS: [[u32; 2]; 3] = [[4, 8], [5, 9], [8, 9]];

/// Columns and rows of a quilt. The leftmost view is at the bottom left, the next is right of it,
/// rows go upwards: as Looking Glass displays take them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ViewGrid {
    columns: u32,
    rows: u32,
}

impl ViewGrid {
    /// Two views beside each other.
    pub const PAIR: Self = Self { columns: 2, rows: 1 };
    /// Nine views in three rows: what WoWvx displays have behind their lenses.
    pub const NINE: Self = Self { columns: 3, rows: 3 };
    /// Two views above each other.
    pub const STACK: Self = Self { columns: 1, rows: 2 };

    /// A grid of 2 to [`MAX_VIEWS`] views; `None` otherwise.
    #[must_use]
    pub fn new(columns: u32, rows: u32) -> Option<Self> {
        let count = columns.checked_mul(rows)?;
        (2..=MAX_VIEWS).contains(&count).then_some(Self { columns, rows })
    }

    /// The usual grid of this many views: a Looking Glass quilt where there is one, else the one
    /// nearest to as many rows as columns, wider than high.
    #[must_use]
    pub fn of_count(count: u32) -> Option<Self> {
        if !(2..=MAX_VIEWS).contains(&count) {
            return None;
        }
        let quilt = QUILTS.into_iter().find(|[columns, rows]| columns * rows == count);
        let square = (1..=count).rev().find(|rows| rows * rows <= count && count.is_multiple_of(*rows));
        let [columns, rows] = quilt.or(square.map(|rows| [count / rows, rows]))?;
        Self::new(columns, rows)
    }

    /// Views beside each other.
    #[must_use]
    pub const fn columns(self) -> u32 {
        self.columns
    }

    /// Views above each other.
    #[must_use]
    pub const fn rows(self) -> u32 {
        self.rows
    }

    /// Views in all.
    #[must_use]
    pub const fn count(self) -> u32 {
        self.columns * self.rows
    }

    /// Column and row, from the top left, of a view counted from the leftmost one.
    #[must_use]
    pub const fn place(self, view: u32) -> [u32; 2] {
        [view % self.columns, self.rows - 1 - view / self.columns]
    }
}

/// `9`, or `9x1` where the grid is not the usual one of its count.
impl fmt::Display for ViewGrid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if Self::of_count(self.count()) == Some(*self) {
            write!(f, "{}", self.count())
        } else {
            write!(f, "{}x{}", self.columns, self.rows)
        }
    }
}

impl FromStr for ViewGrid {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        let grid = match text.split_once('x') {
            Some((columns, rows)) => number(columns).zip(number(rows)).and_then(|(c, r)| Self::new(c, r)),
            None => number(text).and_then(Self::of_count),
        };
        grid.ok_or(())
    }
}

/// A number of views without places of their own: 2 to [`MAX_VIEWS`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ViewCount(u32);

impl ViewCount {
    /// Nine views.
    pub const NINE: Self = Self(9);

    /// The number; `None` if it is out of range.
    #[must_use]
    pub fn new(count: u32) -> Option<Self> {
        (2..=MAX_VIEWS).contains(&count).then_some(Self(count))
    }

    /// The number.
    #[must_use]
    pub const fn get(self) -> u32 {
        self.0
    }
}

impl fmt::Display for ViewCount {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl FromStr for ViewCount {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        number(text).and_then(Self::new).ok_or(())
    }
}

/// A number in a name. Digits only: "+9" and "09" would be second names of the same layout.
fn number(text: &str) -> Option<u32> {
    match text.as_bytes() {
        [b'1'..=b'9', rest @ ..] if rest.iter().all(u8::is_ascii_digit) => text.parse().ok(),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grids_are_those_of_looking_glass_and_else_nearly_square() {
        for (name, columns, rows) in [
            ("2", 2, 1),
            ("7", 7, 1),
            ("9", 3, 3),
            ("12", 4, 3),
            ("32", 4, 8),
            ("45", 5, 9),
            ("48", 8, 6),
            ("66", 11, 6),
            ("72", 8, 9),
            ("9x1", 9, 1),
            ("128", 16, 8),
        ] {
            let grid: ViewGrid = name.parse().unwrap();
            assert_eq!((grid.columns(), grid.rows(), grid.to_string().as_str()), (columns, rows, name));
        }
        assert_eq!("3x3".parse::<ViewGrid>().map(|grid| grid.to_string()), Ok("9".to_owned()));
        for name in
            ["", "0", "1", "129", "x", "3x", "0x9", "+9", "09", "65536x65537", "99999999999", "1x1", "3x3x3"]
        {
            assert_eq!(name.parse::<ViewGrid>(), Err(()), "{name}");
        }
    }

    #[test]
    fn the_leftmost_view_is_at_the_bottom_left_and_the_rightmost_at_the_top_right() {
        let grid = ViewGrid::new(5, 9).unwrap();
        assert_eq!([0, 4, 5, 44].map(|view| grid.place(view)), [[0, 8], [4, 8], [0, 7], [4, 0]]);
    }
}
