//! How long a listing of many items takes, and their making: figures for the documents, no test.

use std::time::Instant;

use relief_store::Filter;

use crate::store::made::{Made, create, edit, point};

const ITEMS: usize = 10_000;
const TIMES: usize = 30;

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
#[ignore = "a measurement: cargo test --release --test services -- --exact store::speed::ten_thousand_items --ignored --nocapture"]
async fn ten_thousand_items() {
    let made = Made::new().await;
    let changes = (0..ITEMS).map(|i| create(&point(&format!("landmark {i}"), i as f64 / 3.0))).collect();
    let begin = Instant::now();
    made.store.apply(&edit("anna", changes)).await.unwrap();
    eprintln!("{ITEMS} items made in {:.0} ms, one edit", begin.elapsed().as_secs_f64() * 1e3);
    let mut times: Vec<f64> = Vec::new();
    for _ in 0..TIMES {
        let begin = Instant::now();
        assert_eq!(made.store.list(&Filter::default()).await.unwrap().items.len(), ITEMS);
        times.push(begin.elapsed().as_secs_f64() * 1e3);
    }
    times.sort_by(f64::total_cmp);
    eprintln!("listed in {:.1} ms (median), {:.1} to {:.1}", times[TIMES / 2], times[0], times[TIMES - 1]);
    let begin = Instant::now();
    for i in 0..100 {
        made.store.apply(&edit("anna", vec![create(&point(&format!("one {i}"), 0.0))])).await.unwrap();
    }
    eprintln!(
        "an edit of one change: {:.2} ms, with its wait for the disk",
        begin.elapsed().as_secs_f64() * 10.0
    );
}
