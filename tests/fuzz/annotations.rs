//! Files of annotations in every format, and templates.

use relief_annotation::{Item, Template};
use relief_exchange::{Format, ReadContext};
use relief_volume::Grid;

/// Checks that read items are valid, are written as JSON and come back the same.
fn read(format: Format, bytes: &[u8]) {
    let grid = Grid::axis_aligned([16, 16, 16], [4.0; 3], [-32.0; 3]).expect("a grid");
    let context = ReadContext {
        author: "fuzz",
        set: "default",
        list: "fuzz",
        frame_of_reference: None,
        grid: Some(&grid),
        series: None,
    };
    let Ok(imported) = relief_exchange::read(format, bytes, &context) else { return };
    for item in &imported.items {
        item.validate().expect("an item that was read is valid");
        let json = serde_json::to_string(item).expect("an item is JSON");
        let again: Item = serde_json::from_str(&json).expect("an item comes back");
        assert_eq!(&again, item);
    }
}

/// One function for each format.
macro_rules! formats {
    ($($name:ident = $format:ident),* $(,)?) => {$(
        pub(crate) fn $name(bytes: &[u8]) {
            read(Format::$format, bytes);
        }
    )*};
}

formats! {
    seg = Seg,
    sr = Sr,
    rtstruct = RtStruct,
    mrk_json = MrkJson,
    fcsv = Fcsv,
    csv = Csv,
    tsv = Tsv,
    mps = Mps,
    cornerstone = Cornerstone,
    seg_nrrd = SegNrrd,
    nifti = Nifti,
    stl = Stl,
    ply = Ply,
    obj = Obj,
    glb = Glb,
}

pub(crate) fn template(bytes: &[u8]) {
    if let Ok(template) = Template::read(bytes) {
        let json = template.json();
        let again = Template::read(json.as_bytes()).expect("a template comes back");
        assert_eq!(again.json(), json);
    }
}
