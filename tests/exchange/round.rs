//! Round trips: the same points and texts, and everything else that the format can hold.

use proptest::prelude::*;

use super::{CONTEXT, TEXTS, asymmetric, everything, frame, ids, landmark, read, same, write};
use relief_annotation::{Geometry, Item, Method, State};
use relief_base::Point;
use relief_exchange::Format;

/// A text as a format has it.
fn plain(format: Format, text: &str) -> String {
    match format {
        Format::Csv | Format::Tsv => text.replace('"', "'").replace('\n', " "),
        Format::Fcsv => text.replace('\n', " "),
        _ => text.to_owned(),
    }
}

/// The item as a format gives it back that has no place for who, when and how.
fn without_history(item: &Item, read: &Item) -> Item {
    Item {
        id: read.id,
        author: read.author.clone(),
        created: read.created,
        placement: read.placement.clone(),
        ..item.clone()
    }
}

#[test]
fn markups_hold_everything() {
    let items = everything();
    let written = write(Format::MrkJson, &items).unwrap();
    let read = read(Format::MrkJson, &written.bytes).unwrap();
    assert_eq!(read.warnings, [] as [&str; 0]);
    assert_eq!(read.items.len(), items.len());
    for item in &items {
        let back = read.items.iter().find(|other| other.id == item.id).unwrap();
        assert!(same(item.geometry.as_ref(), back.geometry.as_ref()), "{item:?}\n{back:?}");
        assert_eq!(Item { geometry: item.geometry.clone(), ..back.clone() }, *item);
    }
    let reported: Vec<&str> = written.left_out.iter().map(|lost| lost.what.as_str()).collect();
    assert_eq!(reported, ["straight parts of curves"]);
}

#[test]
fn cornerstone_holds_all_but_planes_and_what_has_no_place() {
    let mut items = everything();
    for item in &mut items {
        item.frame_of_reference = frame("1.2.3");
    }
    let written = write(Format::Cornerstone, &items).unwrap();
    let reported: Vec<&str> = written.left_out.iter().map(|lost| lost.what.as_str()).collect();
    assert_eq!(reported, ["planes", "items without a place"]);
    let read = read(Format::Cornerstone, &written.bytes).unwrap();
    assert_eq!((read.items.len(), read.warnings.len()), (7, 0));
    for back in &read.items {
        let item = items.iter().find(|item| item.id == back.id).unwrap();
        assert!(same(item.geometry.as_ref(), back.geometry.as_ref()), "{item:?}\n{back:?}");
        assert_eq!(Item { geometry: item.geometry.clone(), ..back.clone() }, *item);
    }
}

#[test]
fn tables_hold_points_with_their_texts_and_flags() {
    for format in [Format::Csv, Format::Tsv, Format::Fcsv] {
        let items = everything();
        let written = write(format, &items).unwrap();
        let reported: Vec<&str> = written.left_out.iter().map(|lost| lost.what.as_str()).collect();
        let kinds = ["lines", "angles", "curves", "planes"];
        assert_eq!(reported[..4], kinds, "{format}");
        for what in ["colours", "concepts", "skipping", "lists"] {
            assert!(reported.contains(&what), "{format}: {reported:?}");
        }
        let points: Vec<&Item> = items
            .iter()
            .filter(|item| matches!(item.geometry, None | Some(Geometry::Point { .. })))
            .collect();
        let read = read(format, &written.bytes).unwrap();
        assert_eq!(read.items.len(), points.len());
        for back in &read.items {
            let item = points.iter().find(|item| item.name == back.name).unwrap();
            let description = plain(format, &item.description);
            let state = if item.geometry.is_none() { State::Missing } else { State::Defined };
            let expected = Item {
                description,
                state,
                list: "file".to_owned(),
                order: back.order,
                rgb: None,
                concept: None,
                ..without_history(item, back)
            };
            assert_eq!(*back, expected, "{format}");
            assert_eq!(back.placement.as_ref().unwrap().method, Method::Import);
            assert_eq!(back.author, CONTEXT.author);
        }
    }
}

#[test]
fn point_sets_hold_points_in_their_order() {
    let items = everything();
    let written = write(Format::Mps, &items).unwrap();
    let reported: Vec<&str> = written.left_out.iter().map(|lost| lost.what.as_str()).collect();
    for what in ["items without a place", "names", "descriptions", "locks", "hiding"] {
        assert!(reported.contains(&what), "{reported:?}");
    }
    let read = read(Format::Mps, &written.bytes).unwrap();
    let points: Vec<_> = read.items.iter().map(|item| item.point().unwrap().xyz.to_array()).collect();
    // The list without a name comes first.
    assert_eq!(points, [[-3.0, -4.0, -5.5], [1.5, 82.25, 40.125], [1.5, 82.25, 40.125]]);
    assert_eq!(read.items[0].name, "file-0");
}

#[test]
fn ids_are_kept_where_a_file_has_them() {
    let items = asymmetric();
    for format in [Format::MrkJson, Format::Fcsv, Format::Cornerstone] {
        let imported = read(format, write(format, &items).unwrap().bytes).unwrap();
        assert_eq!(ids(&imported.items), ids(&items), "{format}");
    }
}

#[test]
fn text_formats_list_items_that_they_cannot_hold() {
    let plane = everything().remove(8);
    for format in TEXTS {
        let refused = write(format, &[]).unwrap_err().to_string();
        assert!(refused.contains("nothing is left to write") && refused.contains("no items"), "{refused}");
        if format != Format::MrkJson {
            let refused = write(format, std::slice::from_ref(&plane)).unwrap_err().to_string();
            assert!(refused.contains("holds point") && refused.contains("1 planes"), "{refused}");
        }
    }
}

#[test]
fn a_context_gives_what_a_file_does_not_say() {
    let uid = frame("1.2.3.4");
    let context = relief_exchange::ReadContext { frame_of_reference: uid.as_ref(), set: "anna", ..CONTEXT };
    for format in TEXTS {
        let bytes = write(format, &asymmetric()).unwrap().bytes;
        for item in relief_exchange::read(format, &bytes, &context).unwrap().items {
            assert_eq!(
                (item.frame_of_reference.as_ref(), item.set.as_str()),
                (uid.as_ref(), "anna"),
                "{format}"
            );
        }
    }
}

/// Usual texts and unusual ones.
fn words(least: usize, most: usize) -> impl Strategy<Value = String> {
    let letter = prop_oneof![
        4 => proptest::char::range('a', 'z'),
        1 => Just(' '),
        1 => proptest::sample::select(vec![',', '"', ';', '#', '\'', '<', '&', '\\', '{', 'é', '骨', '=', '/', ':']),
    ];
    proptest::collection::vec(letter, least..=most)
        .prop_map(|letters| letters.into_iter().collect::<String>())
}

fn any_point() -> impl Strategy<Value = Item> {
    let millimetres = || prop_oneof![4 => -500.0..500.0f64, 1 => -1e6..1e6f64, 1 => Just(0.0)];
    let place = proptest::option::weighted(0.9, [millimetres(), millimetres(), millimetres()]);
    (words(1, 20), words(0, 30), place, any::<[bool; 3]>()).prop_map(|(name, description, place, flags)| {
        let geometry = place.map(|[x, y, z]| Geometry::Point { at_mm: Point::new(x, y, z) });
        let mut item = Item::new(&name, "anna", geometry).unwrap();
        item.description = description;
        [item.locked, item.visible, _] = flags;
        if flags[2] && item.geometry.is_none() {
            item.state = State::Skipped;
        }
        item
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, ..ProptestConfig::default() })]

    /// Any names of points: each format returns what it can hold.
    #[test]
    fn points_come_back(mut items in proptest::collection::vec(any_point(), 1..12)) {
        for (order, item) in (0..).zip(&mut items) {
            item.order = order;
            item.list = "a list".to_owned();
        }
        for format in TEXTS {
            let has_places = items.iter().any(|item| item.geometry.is_some());
            let holds_missing = !matches!(format, Format::Mps | Format::Cornerstone);
            if !has_places && !holds_missing {
                continue;
            }
            let written = write(format, &items).unwrap();
            let back = read(format, &written.bytes)
                .unwrap_or_else(|error| panic!("{error}\n{}", String::from_utf8_lossy(&written.bytes)));
            let held: Vec<&Item> = items.iter().filter(|item| holds_missing || item.geometry.is_some()).collect();
            prop_assert_eq!(back.items.len(), held.len(), "{}", format);
            for (item, back) in held.into_iter().zip(&back.items) {
                prop_assert!(same(item.geometry.as_ref(), back.geometry.as_ref()), "{}", format);
                if format == Format::Mps {
                    continue;
                }
                prop_assert_eq!(&plain(format, &item.name), &back.name, "{}", format);
                prop_assert_eq!(&plain(format, &item.description), &back.description, "{}", format);
                prop_assert_eq!((item.locked, item.visible), (back.locked, back.visible), "{}", format);
                if matches!(format, Format::MrkJson | Format::Cornerstone) {
                    prop_assert_eq!(item, &Item { geometry: item.geometry.clone(), ..back.clone() });
                }
            }
        }
    }
}

#[test]
fn ten_thousand_points_come_back() {
    let items: Vec<Item> =
        (0..10_000).map(|n| landmark(&format!("p{n}"), n, [f64::from(n), 1.0, 2.0])).collect();
    for format in TEXTS {
        let back = read(format, write(format, &items).unwrap().bytes).unwrap();
        assert_eq!(back.items.len(), items.len());
        assert!(back.items.iter().zip(&items).all(|(a, b)| a.geometry == b.geometry), "{format}");
    }
}
