//! Names of quilt files, from which Looking Glass tools read how the views lie in them:
//! `NAME_qsCOLUMNSxROWSaASPECT`, before the ending. The aspect is the width of a view by its height.

use super::grid::ViewGrid;

/// The layout of a quilt by the name of its file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct QuiltName {
    /// Columns and rows.
    pub grid: ViewGrid,
    /// Width of a view by its height; `None` where the name leaves it out.
    pub aspect: Option<f64>,
}

impl QuiltName {
    /// Reads the name of a file without its ending; `None` if it does not name a quilt.
    #[must_use]
    pub fn of(stem: &str) -> Option<Self> {
        let (_, quilt) = stem.rsplit_once("_qs")?;
        let (grid, aspect) = match quilt.split_once('a') {
            Some((grid, aspect)) => (grid, Some(aspect)),
            None => (quilt, None),
        };
        let grid = grid.contains('x').then(|| grid.parse().ok()).flatten()?;
        let aspect = match aspect {
            Some(text) => Some(text.parse::<f64>().ok().filter(|aspect| (0.01..=100.0).contains(aspect))?),
            None => None,
        };
        Some(Self { grid, aspect })
    }

    /// The end of the name of a quilt of views of this size, pixels.
    #[must_use]
    pub fn suffix(grid: ViewGrid, [width, height]: [u32; 2]) -> String {
        let aspect = format!("{:.4}", f64::from(width) / f64::from(height.max(1)));
        let aspect = aspect.trim_end_matches('0').trim_end_matches('.');
        format!("_qs{}x{}a{aspect}", grid.columns(), grid.rows())
    }

    /// Whether views of this size have the aspect of the name, to its rounding.
    #[must_use]
    pub fn fits(&self, [width, height]: [u32; 2]) -> bool {
        let found = f64::from(width) / f64::from(height.max(1));
        self.aspect.is_none_or(|aspect| (found / aspect - 1.0).abs() < 0.01)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_those_of_looking_glass_tools() {
        let grid = ViewGrid::new(5, 9).unwrap();
        assert_eq!(QuiltName::suffix(grid, [420, 560]), "_qs5x9a0.75");
        assert_eq!(QuiltName::suffix(ViewGrid::new(8, 6).unwrap(), [1024, 576]), "_qs8x6a1.7778");
        assert_eq!(QuiltName::suffix(grid, [400, 400]), "_qs5x9a1");
        for (stem, size_px, fits) in [
            ("head_qs5x9a0.75", [420, 560], true),
            ("a_qs3x3_qs5x9a1.777", [960, 540], true),
            ("head_qs5x9a0.75", [560, 420], false),
            ("head_qs5x9", [1, 77], true),
        ] {
            let name = QuiltName::of(stem).unwrap();
            assert_eq!((name.grid, name.fits(size_px)), (grid, fits), "{stem}");
        }
        for stem in [
            "head",
            "head_qs",
            "head_qs45",
            "head_qs5x9a",
            "head_qs5x9anan",
            "head_qs0x9a1",
            "head_qs99x99a1",
        ] {
            assert_eq!(QuiltName::of(stem), None, "{stem}");
        }
    }
}
