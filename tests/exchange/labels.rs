//! Label maps: segments become regions with the voxels and volumes that others counted, and are written again.

use std::collections::HashMap;

use super::{CONTEXT, common, read, refused};
use relief::annotation::{ContentId, Geometry, Item, RegionSummary};
use relief::exchange::{self, Format, Imported, ReadContext, WriteContext};
use relief::volume::{Grid, LabelMap, Segment};

fn summary(item: &Item) -> &RegionSummary {
    match item.geometry.as_ref().unwrap() {
        Geometry::Region(region) => region,
        other => panic!("{other:?}"),
    }
}

fn contents(imported: &[&Imported]) -> HashMap<ContentId, Vec<u8>> {
    let all = imported.iter().flat_map(|imported| &imported.contents);
    all.map(|(id, _, bytes)| (id.clone(), bytes.clone())).collect()
}

/// A map of 4 x 3 x 2 voxels of 2 mm with these labels.
fn map(origin: f64, labels: &[u16; 24], names: &[&str]) -> Vec<u8> {
    let grid = Grid::axis_aligned([4, 3, 2], [2.0; 3], [origin, 10.0, 20.0]).unwrap();
    let segments =
        (1..).zip(names).map(|(label, name)| Segment::new(label, Some(name), Some([0.5, 0.25, 1.0])));
    relief::formats::seg_nrrd(&LabelMap::new(grid, labels, segments.collect()).unwrap()).unwrap()
}

#[test]
fn regions_have_the_voxels_that_others_counted() {
    let Some(folder) = common::unpacked("labels of TotalSegmentator", "interop") else { return };
    let facts = common::facts(&common::shared_data("facts of files").unwrap(), "interop.facts.json");
    let known = facts["totalseg-abdomen-j2k_labels"]["labels"].as_object().unwrap();
    let bytes = std::fs::read(folder.join("nifti/totalseg-abdomen-j2k_labels.nii.gz")).unwrap();
    let imported = read(Format::Nifti, &bytes).unwrap();
    assert_eq!((imported.items.len(), imported.contents.len()), (known.len(), 1));
    for item in &imported.items {
        let region = summary(item);
        let fact = &known[&region.label.to_string()];
        assert_eq!(fact["n_voxels"], region.voxels, "{}", region.label);
        assert!((region.volume_ml - fact["volume_ml"].as_f64().unwrap()).abs() < 1e-3, "{region:?} {fact}");
        assert_eq!(region.content, imported.contents[0].0);
    }
    // Written again, and read: numbered anew, with the same voxels.
    let contents = contents(&[&imported]);
    let context = WriteContext { contents: &|id| contents.get(id).cloned(), grid: None, series: None };
    for format in [Format::SegNrrd, Format::Nifti] {
        let written = exchange::write(format, &imported.items, &context).unwrap();
        assert_eq!(written.items, known.len());
        let back = read(format, &written.bytes).unwrap();
        for (item, back) in imported.items.iter().zip(&back.items) {
            assert_eq!((&item.name, summary(item).voxels), (&back.name, summary(back).voxels), "{format}");
        }
    }
}

#[test]
fn segments_of_slicer_keep_their_names() {
    let Some(folder) = common::unpacked("a segmentation of 3D Slicer", "interop") else { return };
    let bytes = std::fs::read(folder.join("slicer/Segmentation.seg.nrrd")).unwrap();
    let imported = read(Format::SegNrrd, bytes).unwrap();
    let names: Vec<&str> = imported.items.iter().map(|item| item.name.as_str()).collect();
    assert_eq!(
        names,
        [
            "ribs",
            "cervical vertebral column",
            "thoracic vertebral column",
            "lumbar vertebral column",
            "right lung",
            "left lung",
            "tissue"
        ]
    );
    assert!(imported.items.iter().all(|item| item.rgb.is_some() && item.list == "file"));
}

#[test]
fn regions_of_several_maps_are_written_to_one_and_overlaps_are_told() {
    let mut labels = [0u16; 24];
    labels[..3].copy_from_slice(&[1, 1, 2]);
    let first = read(Format::SegNrrd, map(0.0, &labels, &["liver", "spleen"])).unwrap();
    // Half a voxel aside, so that the nearest are taken; two voxels of it are those of the first map.
    let second = read(Format::SegNrrd, map(0.5, &labels, &["tumour", "other"])).unwrap();
    let contents = contents(&[&first, &second]);
    let context = WriteContext { contents: &|id| contents.get(id).cloned(), grid: None, series: None };
    let mut items = first.items.clone();
    items.push(Item { order: 9, description: "told".to_owned(), locked: true, ..second.items[0].clone() });
    let written = exchange::write(Format::SegNrrd, &items, &context).unwrap();
    let back = read(Format::SegNrrd, &written.bytes).unwrap();
    let found: Vec<(&str, u64)> =
        back.items.iter().map(|item| (item.name.as_str(), summary(item).voxels)).collect();
    assert_eq!(found, [("spleen", 1), ("tumour", 2)]);
    assert_eq!(back.items[0].rgb, Some([0.5, 0.25, 1.0]));
    let told: Vec<&str> = written.left_out.iter().map(|lost| lost.what.as_str()).collect();
    assert_eq!(told[..2], ["descriptions", "locks"]);
    assert!(told.contains(&"2 voxels that another region has too"), "{told:?}");
    assert_eq!(written.left_out.last().unwrap().items, [items[0].id]);
}

#[test]
fn what_is_wrong_with_a_map_is_told() {
    let whole = map(0.0, &[1; 24], &["all"]);
    for cut in [0, 10, 100, whole.len() - 12] {
        let message = refused(Format::SegNrrd, &whole[..cut]);
        assert!(message.starts_with("seg.nrrd: the map: "), "{message}");
        assert!(!message.contains("/tmp"), "{message}: no file of ours is named");
    }
    let empty = refused(Format::SegNrrd, map(0.0, &[0; 24], &["none"]));
    assert!(empty.contains("without labelled voxels"), "{empty}");
    let imported = read(Format::SegNrrd, &whole).unwrap();
    let message = exchange::write(
        Format::SegNrrd,
        &imported.items,
        &WriteContext { contents: &|_| None, grid: None, series: None },
    )
    .unwrap_err();
    assert!(message.to_string().contains("is not there, allowed: the voxels of the region"), "{message}");
    let grid = Grid::axis_aligned([4, 3, 2], [2.0; 3], [100.0, 10.0, 20.0]).unwrap();
    let context = ReadContext { grid: Some(&grid), ..CONTEXT };
    let warned = exchange::read(Format::SegNrrd, &whole, &context).unwrap().warnings;
    assert_eq!(warned, ["the map lies outside of the volume; is it of the same scan?"]);
}
