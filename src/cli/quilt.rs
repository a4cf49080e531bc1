//! Names of files of quilts, which tell other programs how the views lie in them.

use std::path::Path;

use anyhow::bail;

use relief_display::{Layout, QuiltName};

/// The layout of a file: the given one, or the quilt that its name says.
///
/// # Errors
/// When the name says another quilt than the layout.
pub(crate) fn layout_of(path: &Path, layout: Option<Layout>) -> anyhow::Result<Option<Layout>> {
    let Some(QuiltName { grid, .. }) = name_of(path) else { return Ok(layout) };
    let named = Layout::Views(grid);
    match layout {
        Some(other) if other != named => bail!(
            "the file's name says that it is a quilt of {}x{} views, --layout is {other}: change one of them",
            grid.columns(),
            grid.rows()
        ),
        _ => Ok(Some(named)),
    }
}

/// Refuses a name with another aspect than that of the views, of `size_px` pixels.
pub(crate) fn check_aspect(path: &Path, size_px: [u32; 2]) -> anyhow::Result<()> {
    let Some(name) = name_of(path).filter(|name| !name.fits(size_px)) else { return Ok(()) };
    bail!(
        "the file's name says views with an aspect of {}, those of {}x{} end a name with {}",
        name.aspect.unwrap_or_default(),
        size_px[0],
        size_px[1],
        QuiltName::suffix(name.grid, size_px)
    )
}

/// A line for the user of a quilt whose name does not say how its views lie.
pub(crate) fn hint(path: &Path, layout: Layout, size_px: [u32; 2]) -> Option<String> {
    let Layout::Views(grid) = layout else { return None };
    let is_png = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png"));
    let stem = path.file_stem().filter(|_| is_png && name_of(path).is_none())?.to_str()?;
    Some(format!(
        "Looking Glass tools read columns, rows and aspect from the file's name: {stem}{}",
        QuiltName::suffix(grid, size_px)
    ))
}

/// Whether a file has the name of a quilt.
pub(crate) fn is_named(path: &Path) -> bool {
    name_of(path).is_some()
}

fn name_of(path: &Path) -> Option<QuiltName> {
    QuiltName::of(path.file_stem()?.to_str()?)
}
