//! Label maps: segments become regions with the voxels and volumes that others counted, and are
//! written again.

use std::collections::HashMap;

use super::{CONTEXT, common, read, refused};
use relief_annotation::{ContentId, Geometry, Item, RegionSummary};
use relief_exchange::{Format, Imported, ReadContext, WriteContext};
use relief_volume::{Grid, LabelMap, Segment};

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
    relief_dicom::write_seg_nrrd(&LabelMap::new(grid, labels, segments.collect()).unwrap()).unwrap()
}

#[test]
fn regions_have_the_voxels_that_others_counted() {
    let Some(folder) = common::unpacked("labels of TotalSegmentator", "interop", &["nifti"]) else { return };
    let facts = common::facts(
        &common::shared_data("facts of files", &["interop.facts.json"]).unwrap(),
        "interop.facts.json",
    );
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
    // Written again, and read: renumbered, with the same voxels.
    let contents = contents(&[&imported]);
    let context = WriteContext {
        contents: &|id| contents.get(id).cloned(),
        grid: None,
        series: None,
        phase: None,
        warnings: &[],
    };
    for format in [Format::SegNrrd, Format::Nifti] {
        let written = relief_exchange::write(format, &imported.items, &context).unwrap();
        assert_eq!(written.items, known.len());
        let back = read(format, &written.bytes).unwrap();
        for (item, back) in imported.items.iter().zip(&back.items) {
            assert_eq!((&item.name, summary(item).voxels), (&back.name, summary(back).voxels), "{format}");
        }
    }
}

#[test]
fn segments_of_slicer_keep_their_names() {
    let Some(folder) = common::unpacked("a segmentation of 3D Slicer", "interop", &["slicer"]) else {
        return;
    };
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
fn regions_of_several_maps_are_written_to_one_and_what_overlaps_stays_where_it_can() {
    let mut labels = [0u16; 24];
    labels[..3].copy_from_slice(&[1, 1, 2]);
    let first = read(Format::SegNrrd, map(0.0, &labels, &["liver", "spleen"])).unwrap();
    // Half a voxel aside, so that the nearest are taken; two voxels of it are those of the first
    // map.
    let second = read(Format::SegNrrd, map(0.5, &labels, &["tumour", "other"])).unwrap();
    let contents = contents(&[&first, &second]);
    let context = WriteContext {
        contents: &|id| contents.get(id).cloned(),
        grid: None,
        series: None,
        phase: None,
        warnings: &[],
    };
    let mut items = first.items.clone();
    items.push(Item {
        order: 9,
        description: "reported".to_owned(),
        locked: true,
        ..second.items[0].clone()
    });
    let written = relief_exchange::write(Format::SegNrrd, &items, &context).unwrap();
    assert!(String::from_utf8_lossy(&written.bytes).contains("sizes: 2 4 3 2"), "two layers");
    let back = read(Format::SegNrrd, &written.bytes).unwrap();
    let found = |back: &Imported| -> Vec<(String, u64)> {
        back.items.iter().map(|item| (item.name.clone(), summary(item).voxels)).collect()
    };
    let all = [("liver", 2), ("spleen", 1), ("tumour", 2)].map(|(name, voxels)| (name.to_owned(), voxels));
    assert_eq!(found(&back), all);
    assert_eq!(back.contents.len(), 2, "a content for each layer");
    assert_eq!(back.items[0].rgb, Some([0.5, 0.25, 1.0]));
    let reported: Vec<&str> = written.left_out.iter().map(|lost| lost.what.as_str()).collect();
    assert_eq!(reported[..2], ["descriptions", "locks"]);
    assert!(!reported.iter().any(|what| what.contains("voxels")), "{reported:?}");
    // And once more, from the layers.
    let contents = self::contents(&[&back]);
    let context = WriteContext {
        contents: &|id| contents.get(id).cloned(),
        grid: None,
        series: None,
        phase: None,
        warnings: &[],
    };
    let again = relief_exchange::write(Format::SegNrrd, &back.items, &context).unwrap();
    assert_eq!(found(&read(Format::SegNrrd, &again.bytes).unwrap()), all);
    // NIfTI has one label for each voxel.
    let written = relief_exchange::write(Format::Nifti, &back.items, &context).unwrap();
    assert_eq!(found(&read(Format::Nifti, &written.bytes).unwrap()), all[1..]);
    let lost = written.left_out.last().unwrap();
    assert_eq!(
        (lost.what.as_str(), &lost.items),
        ("2 voxels that another region has too", &vec![back.items[0].id])
    );
}

#[test]
fn invalid_label_maps_are_refused_with_the_reason() {
    let whole = map(0.0, &[1; 24], &["all"]);
    for cut in [0, 10, 100, whole.len() - 12] {
        let message = refused(Format::SegNrrd, &whole[..cut]);
        assert!(message.starts_with("seg.nrrd: the map: "), "{message}");
        assert!(!message.contains("/tmp"), "{message}: no file of ours is named");
    }
    let empty = refused(Format::SegNrrd, map(0.0, &[0; 24], &["none"]));
    assert!(empty.contains("without labelled voxels"), "{empty}");
    let imported = read(Format::SegNrrd, &whole).unwrap();
    let message = relief_exchange::write(
        Format::SegNrrd,
        &imported.items,
        &WriteContext { contents: &|_| None, grid: None, series: None, phase: None, warnings: &[] },
    )
    .unwrap_err();
    assert!(message.to_string().contains("is not there, allowed: the voxels of the region"), "{message}");
    let grid = Grid::axis_aligned([4, 3, 2], [2.0; 3], [100.0, 10.0, 20.0]).unwrap();
    let context = ReadContext { grid: Some(&grid), ..CONTEXT };
    let warned = relief_exchange::read(Format::SegNrrd, &whole, &context).unwrap().warnings;
    assert_eq!(warned, ["the map lies outside of the volume; is it of the same scan?"]);
}

/// Invariant: Overlapping segments are exchanged completely, as highdicom, 3D Slicer, pynrrd and
/// slicerio read them.
///
/// Every segment of 3D Slicer's own sample is whole, the sphere in a layer over the others too.
#[test]
fn overlapping_segments_of_slicer_are_all_whole() {
    let Some(folder) = common::unpacked("overlapping segments of 3D Slicer", "interop", &["slicer"]) else {
        return;
    };
    let facts = common::facts(
        &common::shared_data("facts of files", &["interop.facts.json"]).unwrap(),
        "interop.facts.json",
    );
    let whole = &facts["slicer_Segmentation.seg.nrrd"]["label_counts"];
    let bytes = std::fs::read(folder.join("slicer/SegmentationOverlapping.seg.nrrd")).unwrap();
    let imported = read(Format::SegNrrd, &bytes).unwrap();
    assert_eq!((imported.items.len(), imported.contents.len()), (8, 2), "{:?}", imported.warnings);
    for item in &imported.items {
        let region = summary(item);
        if item.name == "overlapping sphere" {
            assert_eq!(region.voxels, 27_626 - 8_487, "the sphere");
        } else {
            assert_eq!(whole[region.label.to_string()], region.voxels, "{}", item.name);
        }
    }
}

const LAYERS: &str = r"
import json, sys, nrrd, slicerio
path = sys.argv[1] + '/ours.seg.nrrd'
data, header = nrrd.read(path)
found = {'sizes': header['sizes'].tolist(), 'kinds': header['kinds'], 'segments': []}
for segment in slicerio.read_segmentation(path)['segments']:
    found['segments'].append([segment['name'], int((data[segment['layer']] == segment['labelValue']).sum())])
print(json.dumps(found))
";

/// Invariant: Overlapping segments are exchanged completely, as highdicom, 3D Slicer, pynrrd and
/// slicerio read them.
///
/// Layers as pynrrd and slicerio read them.
#[test]
fn layers_are_read_by_others() {
    let mut labels = [0u16; 24];
    labels[..3].copy_from_slice(&[1, 1, 2]);
    let first = read(Format::SegNrrd, map(0.0, &labels, &["liver", "spleen"])).unwrap();
    labels[..6].copy_from_slice(&[0, 1, 1, 1, 2, 2]);
    let second = read(Format::SegNrrd, map(0.0, &labels, &["tumour", "other"])).unwrap();
    let contents = contents(&[&first, &second]);
    let context = WriteContext {
        contents: &|id| contents.get(id).cloned(),
        grid: None,
        series: None,
        phase: None,
        warnings: &[],
    };
    let mut items = first.items.clone();
    items.extend((5..).zip(&second.items).map(|(order, item)| Item { order, ..item.clone() }));
    let written = relief_exchange::write(Format::SegNrrd, &items, &context).unwrap();
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("ours.seg.nrrd"), &written.bytes).unwrap();
    let Some(found) = super::peer::reported("layers read by slicerio", LAYERS, folder.path(), false) else {
        return;
    };
    assert_eq!(found["sizes"], serde_json::json!([2, 4, 3, 2]));
    assert_eq!(found["kinds"], serde_json::json!(["list", "domain", "domain", "domain"]));
    let segments = serde_json::json!([["liver", 2], ["spleen", 1], ["tumour", 3], ["other", 2]]);
    assert_eq!(found["segments"], segments);
}
