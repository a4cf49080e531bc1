//! Text files that are read whole.

use std::path::Path;

use anyhow::Context;
/// A small text file; a larger one is something else.
pub(super) fn read_text(path: &Path) -> anyhow::Result<String> {
    use std::io::Read;
    let read = || -> std::io::Result<String> {
        let mut text = String::new();
        std::fs::File::open(path)?.take(1 << 20).read_to_string(&mut text)?;
        Ok(text)
    };
    read().with_context(|| format!("cannot read {}", path.display()))
}
