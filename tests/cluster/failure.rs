//! Two servers behind nginx, one of which is killed during requests for frames and edits of
//! annotations.

use std::collections::{HashMap, HashSet};
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use futures_util::{SinkExt, StreamExt};
use serde_json::{Value, json};
use tokio_tungstenite::tungstenite::Message;
use tokio_tungstenite::tungstenite::client::ClientRequestBuilder;

use crate::cluster::stage::{Answer, Cluster, PATIENCE, ask, can_run, get, lone, phantom, until, volumes};
use crate::common::child::signal;

const REQUESTS: usize = 1000;
const CLIENTS: usize = 4;
/// Different pictures of each volume.
const POSES: usize = 100;

fn frame_path(volume: &str, pose: usize) -> String {
    let (azimuth, elevation) = (pose * 36 / 10, pose % 7 * 10);
    format!(
        "/v1/volumes/{volume}/frame?layout=color&size_px=48,32&preset=bone&azimuth_deg={azimuth}&elevation_deg={elevation}&zoom=1.{pose:02}"
    )
}

/// Asks until an answer comes; counts how often none came. Never for an answer that was refused.
fn persistent(address: &str, line: &str, headers: &str, body: &str, retries: &AtomicUsize) -> Answer {
    loop {
        match ask(address, line, headers, body) {
            Ok(answer) if !matches!(answer.status, 502 | 504) => return answer,
            _ => {
                retries.fetch_add(1, Ordering::SeqCst);
                std::thread::sleep(Duration::from_millis(50));
            }
        }
    }
}

/// Orders that a server has rendered.
fn rendered(address: &str) -> u64 {
    let text = String::from_utf8(get(address, "/metrics", "").body).unwrap();
    let line = text.lines().find_map(|line| line.strip_prefix("relief_render_seconds_count "));
    line.map_or(0, |count| count.parse().unwrap())
}

fn point(id: &str, name: &str) -> Value {
    json!({ "changes": [{ "change": "create",
        "item": { "id": id, "name": name, "geometry": { "kind": "point", "at_mm": [1.0, 2.0, 3.0] } } }] })
}

/// Makes landmarks until it is stopped; returns the ids of the acknowledged ones.
fn annotate(address: &str, volume: &str, is_over: &AtomicBool, retries: &AtomicUsize) -> Vec<String> {
    let mut made = Vec::new();
    while !is_over.load(Ordering::SeqCst) {
        let id = format!("{:08x}-0000-4000-8000-000000000000", made.len() + 1);
        let body = point(&id, &format!("p{}", made.len())).to_string();
        let line = format!("POST /v1/volumes/{volume}/annotations");
        let answer = persistent(address, &line, "Relief-Author: anna\r\n", &body, retries);
        // The landmark exists already, although its answer was lost: it was made once.
        assert!(matches!(answer.status, 201 | 409), "{}", String::from_utf8_lossy(&answer.body));
        made.push(id);
        std::thread::sleep(Duration::from_millis(20));
    }
    made
}

/// Invariant: Servers of one build, adapter and set of series return the same bytes and entity
/// tags; a server that dies causes no wrong image and loses no annotation.
#[test]
fn a_server_that_is_killed_costs_no_wrong_image_and_no_annotation() {
    if !can_run("a_server_that_is_killed_costs_no_wrong_image_and_no_annotation") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let series = ["axes", "slab"].map(|kind| phantom(folder.path(), kind));
    let (alone, address) = lone(&series);
    let ids = volumes(&address);
    let paths: Vec<String> =
        (0..POSES).flat_map(|pose| ids.iter().map(move |id| frame_path(id, pose))).collect();
    let expected: HashMap<&String, Answer> =
        paths.iter().map(|path| (path, get(&address, path, ""))).collect();
    assert!(expected.values().all(|answer| answer.status == 200), "{:?}", expected.values().next());
    assert_eq!(alone.stop(), Some(0));
    let pictures: HashSet<&Vec<u8>> = expected.values().map(|answer| &answer.body).collect();
    assert!(pictures.len() > POSES, "the poses are different pictures: {}", pictures.len());

    let cluster = Cluster::start(&series);
    let all = cluster.address.clone();
    assert_eq!(cluster.servers.len(), 2);
    both_servers_agree(&cluster, &paths[..20], &expected);

    let Storm { killed_at, retries, edit_retries, made, wrong } = storm(&cluster, &ids[0], &paths, &expected);
    assert!(wrong.is_empty(), "{} of {REQUESTS} are wrong: {:?}", wrong.len(), wrong.first());
    eprintln!(
        "{REQUESTS} frames, one server of two killed after {killed_at}: {retries} asked for again by clients, {} annotations, {edit_retries} of them made again",
        made.len()
    );
    assert!((REQUESTS / 3..REQUESTS).contains(&killed_at), "in the middle: {killed_at}");
    assert!(retries <= CLIENTS, "{retries} frames were asked for again, and {CLIENTS} were in flight");
    let listed = get(&all, &format!("/v1/volumes/{}/annotations", ids[0]), "").json();
    let items = listed["items"].as_array().unwrap();
    let found: Vec<&str> = items.iter().map(|known| known["item"]["id"].as_str().unwrap()).collect();
    let distinct: HashSet<&str> = found.iter().copied().collect();
    assert_eq!(distinct.len(), found.len());
    assert!(
        made.len() > 10 && made.iter().all(|id| distinct.contains(id.as_str())),
        "{} of {}",
        found.len(),
        made.len()
    );
    assert_eq!(found.len(), made.len(), "none that nobody made");
    assert_eq!(cluster.process.stop(), Some(143), "reported to stop");
}

/// The results of a storm.
struct Storm {
    /// Frames that were there when the server was killed.
    killed_at: usize,
    /// Frames that clients had to ask for again.
    retries: usize,
    edit_retries: usize,
    /// Ids of the annotations that were acknowledged.
    made: Vec<String>,
    wrong: Vec<String>,
}

/// Asks for all frames from several clients and makes annotations, while one server is killed.
fn storm(cluster: &Cluster, volume: &str, paths: &[String], expected: &HashMap<&String, Answer>) -> Storm {
    let all = &cluster.address;
    let (next, done) = (AtomicUsize::new(0), AtomicUsize::new(0));
    let (retries, edit_retries, is_over) = (AtomicUsize::new(0), AtomicUsize::new(0), AtomicBool::new(false));
    let wrong = Mutex::new(Vec::new());
    let mut killed_at = 0;
    let made = std::thread::scope(|scope| {
        let annotating = scope.spawn(|| annotate(all, volume, &is_over, &edit_retries));
        for _ in 0..CLIENTS {
            scope.spawn(|| {
                loop {
                    let i = next.fetch_add(1, Ordering::SeqCst);
                    if i >= REQUESTS {
                        return;
                    }
                    let path = &paths[i * 7 % paths.len()];
                    // Every other request bypasses nginx's cache, because its picture is new.
                    let headers = if i % 2 == 0 { "Cache-Control: no-cache\r\n" } else { "" };
                    let answer = persistent(all, &format!("GET {path}"), headers, "", &retries);
                    let right = &expected[path];
                    let is_tagged = answer.header("etag") == right.header("etag");
                    if answer.status != 200 || answer.body != right.body || !is_tagged {
                        wrong.lock().unwrap().push(format!("{path}: {} {}", answer.status, answer.head));
                    }
                    done.fetch_add(1, Ordering::SeqCst);
                }
            });
        }
        until("a third of the frames", || done.load(Ordering::SeqCst) > REQUESTS / 3);
        // The one that has the work.
        let (pid, _) = cluster.servers.iter().max_by_key(|(_, address)| rendered(address)).unwrap();
        signal("KILL", *pid);
        killed_at = done.load(Ordering::SeqCst);
        until("all frames", || done.load(Ordering::SeqCst) == REQUESTS);
        is_over.store(true, Ordering::SeqCst);
        annotating.join().unwrap()
    });
    let (retries, edit_retries) = (retries.into_inner(), edit_retries.into_inner());
    Storm { killed_at, retries, edit_retries, made, wrong: wrong.into_inner().unwrap() }
}

/// The same request to two servers: the same bytes, the same tag, which each knows of the other.
fn both_servers_agree(cluster: &Cluster, paths: &[String], expected: &HashMap<&String, Answer>) {
    for path in paths {
        let right = &expected[path];
        let tag = right.header("etag").unwrap();
        for (_, server) in &cluster.servers {
            let answer = get(server, path, "");
            assert_eq!((answer.status, answer.header("etag")), (200, Some(tag)), "{path}");
            assert!(answer.body == right.body, "{path}: other bytes");
            assert_eq!(get(server, path, &format!("If-None-Match: {tag}\r\n")).status, 304);
        }
        let known = get(&cluster.address, path, &format!("If-None-Match: {tag}\r\n"));
        assert_eq!(known.status, 304, "{}", known.head);
    }
    let path = &paths[0];
    let kept: Vec<_> = (0..2).map(|_| get(&cluster.address, path, "")).collect();
    assert_eq!(kept[1].header("relief-cache"), Some("HIT"), "{}", kept[1].head);
    assert!(kept.iter().all(|answer| answer.body == expected[path].body));
    let fresh = get(&cluster.address, path, "Cache-Control: no-cache\r\n");
    assert_eq!(fresh.header("relief-cache"), Some("BYPASS"));
    let annotated = format!("{path}&annotations=true");
    for _ in 0..2 {
        assert_eq!(get(&cluster.address, &annotated, "").header("relief-cache"), Some("BYPASS"));
    }
    let tag = get(&cluster.address, &annotated, "").header("etag").unwrap().to_owned();
    let known = get(&cluster.address, &annotated, &format!("If-None-Match: {tag}\r\n"));
    assert_eq!(known.status, 304, "a tag passes through to the server: {}", known.head);
    for (method, path) in [("POST", "/v1/volumes".to_owned()), ("POST", path.replace("/frame", "/labels"))] {
        let refused = ask(&cluster.address, &format!("{method} {path}"), "", "{}").unwrap();
        assert_eq!(refused.status, 403, "what one server alone would know: {}", refused.head);
    }
    assert_eq!(get(&cluster.address, "/metrics", "").status, 404);
}

/// A live session, at an address and with a query.
struct Live(tokio_tungstenite::WebSocketStream<tokio_tungstenite::MaybeTlsStream<tokio::net::TcpStream>>);

impl Live {
    async fn open(address: &str, query: &str, hello: Value) -> Self {
        let uri = format!("ws://{address}/v1/session{query}").parse().unwrap();
        let request = ClientRequestBuilder::new(uri).with_sub_protocol("relief.v1");
        let (mut socket, _) = tokio_tungstenite::connect_async(request).await.unwrap();
        socket.send(Message::text(hello.to_string())).await.unwrap();
        let mut live = Self(socket);
        live.text("welcome").await;
        live
    }

    /// The next message of a type; frames are acknowledged on the way.
    async fn text(&mut self, kind: &str) -> Value {
        loop {
            match tokio::time::timeout(PATIENCE, self.0.next()).await.expect("something in time") {
                Some(Ok(Message::Text(text))) => {
                    let message: Value = serde_json::from_str(&text).unwrap();
                    if message["type"] == kind {
                        return message;
                    }
                }
                Some(Ok(Message::Binary(frame))) => {
                    let sequence = relief_live::Parts::of(&frame).unwrap().header.sequence;
                    let ack = json!({ "type": "ack", "frame": sequence, "t_ns": 1 });
                    self.0.send(Message::text(ack.to_string())).await.unwrap();
                }
                Some(Ok(_)) => {}
                ended => panic!("{ended:?} before {kind}"),
            }
        }
    }

    /// The names of the items of the next events.
    async fn reported(&mut self) -> Value {
        loop {
            let message = self.text("annotations").await;
            if let Some(event) = message["events"].as_array().and_then(|events| events.first()) {
                return event["item"]["name"].clone();
            }
        }
    }
}

/// Invariant: Servers of one build, adapter and set of series return the same bytes and entity
/// tags; a server that dies causes no wrong image and loses no annotation.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn clients_of_every_server_see_an_edit_that_came_by_any() {
    if !can_run("clients_of_every_server_see_an_edit_that_came_by_any") {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let series = [phantom(folder.path(), "sphere")];
    let cluster = Cluster::start(&series);
    let [(_, a), (_, b)] = &cluster.servers[..] else { panic!("two servers") };
    let volume = volumes(a).remove(0);
    let hello = |author: &str| {
        json!({ "type": "hello", "volume": volume, "author": author, "size_px": [64, 64],
            "settings": { "annotations": true, "display": { "layout": "color" } } })
    };
    let mut anna = Live::open(a, "", hello("anna")).await;
    let mut ben = Live::open(b, "", hello("ben")).await;
    let mut cleo = Live::open(&cluster.address, &format!("?volume={volume}"), hello("cleo")).await;
    let path = format!("/v1/volumes/{volume}/annotations");
    for (server, author, id, name) in
        [(a, "anna", 1, "by a"), (b, "ben", 2, "by b"), (&cluster.address, "cleo", 3, "by nginx")]
    {
        let before = get(a, &format!("{}&annotations=true", frame_path(&volume, 1)), "")
            .header("etag")
            .unwrap()
            .to_owned();
        let body = point(&format!("{id:08x}-0000-4000-8000-000000000000"), name).to_string();
        let made =
            ask(server, &format!("POST {path}"), &format!("Relief-Author: {author}\r\n"), &body).unwrap();
        assert_eq!(made.status, 201, "{}", String::from_utf8_lossy(&made.body));
        for client in [&mut anna, &mut ben, &mut cleo] {
            assert_eq!(client.reported().await, name);
        }
        let after = [a, b, &cluster.address]
            .map(|server| get(server, &format!("{}&annotations=true", frame_path(&volume, 1)), ""));
        assert!(
            after.iter().all(
                |answer| answer.body == after[0].body && answer.header("etag") == after[0].header("etag")
            )
        );
        assert_ne!(after[0].header("etag"), Some(before.as_str()), "the picture has the new landmark");
    }
    drop((anna, ben, cleo));
    assert_eq!(cluster.process.stop(), Some(143));
}
