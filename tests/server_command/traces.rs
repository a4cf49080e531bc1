//! Spans for a collector of OpenTelemetry, which is a listener of this test.

use std::collections::HashMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpListener;
use std::sync::mpsc;
use std::time::Duration;

use opentelemetry_proto::tonic::collector::trace::v1::ExportTraceServiceRequest;
use opentelemetry_proto::tonic::common::v1::any_value::Value;
use opentelemetry_proto::tonic::trace::v1::Span;
use prost::Message;

use super::{Running, phantom, relief};

/// Takes requests until the server's end is dropped, and hands over their bodies with their paths.
fn collector() -> (String, mpsc::Receiver<(String, Vec<u8>)>) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", listener.local_addr().unwrap());
    let (sender, receiver) = mpsc::sync_channel(64);
    std::thread::Builder::new()
        .name("collector".to_owned())
        .spawn(move || {
            for stream in listener.incoming() {
                let mut stream = BufReader::new(stream.unwrap());
                let (mut line, mut length, mut header) = (String::new(), 0, String::new());
                stream.read_line(&mut line).unwrap();
                while stream.read_line(&mut header).unwrap() > 2 {
                    if let Some(value) = header.to_ascii_lowercase().strip_prefix("content-length:") {
                        length = value.trim().parse().unwrap();
                    }
                    header.clear();
                }
                let mut body = vec![0; length];
                stream.read_exact(&mut body).unwrap();
                let answer = b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\nConnection: close\r\n\r\n";
                stream.get_mut().write_all(answer).unwrap();
                if sender.send((line, body)).is_err() {
                    return;
                }
            }
        })
        .unwrap();
    (url, receiver)
}

fn text(span: &Span, key: &str) -> Option<String> {
    let attribute = span.attributes.iter().find(|attribute| attribute.key == key)?;
    match attribute.value.as_ref()?.value.as_ref()? {
        Value::StringValue(text) => Some(text.clone()),
        _ => None,
    }
}

/// Invariant: A collector of traces gets each request with its frame as a child, and nothing that names
/// a patient.
#[test]
fn a_collector_gets_a_request_and_its_frame() {
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path());
    let (url, received) = collector();
    let arguments = ["serve", "--series", &series, "--listen", "127.0.0.1:0", "--traces", &url];
    let running = Running::spawn(&mut relief(&arguments));
    running.await_ready();
    let listed: serde_json::Value = serde_json::from_slice(&running.get("/v1/volumes").1).unwrap();
    let id = listed["volumes"][0]["id"].as_str().unwrap();
    let path = format!("GET /v1/volumes/{id}/frame?size_px=64,36&layout=color");
    let (head, _) = running.ask(&path, "X-Request-Id: story\r\n", &[]);
    assert!(head.starts_with("HTTP/1.1 200"), "{head}");
    // The example of the W3C's recommendation; and one that names no trace.
    let caller = "00-4bf92f3577b34da6a3ce929d0e0e4736-00f067aa0ba902b7-01";
    for (id, parent) in [("joined", caller), ("alone", "00-0-0-01")] {
        let headers = format!("X-Request-Id: {id}\r\ntraceparent: {parent}\r\ntracestate: a=1\r\n");
        assert!(running.ask(&path, &headers, &[]).0.starts_with("HTTP/1.1 200"));
    }
    // The last batch is sent before the program ends.
    let (status, log) = running.stop("TERM");
    assert_eq!(status, Some(0), "{log}");
    let mut spans = HashMap::new();
    while let Ok((line, body)) = received.recv_timeout(Duration::from_millis(200)) {
        assert!(line.starts_with("POST /v1/traces "), "{line}");
        assert!(!body.windows(7).any(|seven| seven == b"PHANTOM"), "a patient is named");
        let request = ExportTraceServiceRequest::decode(body.as_slice()).unwrap();
        for resource in request.resource_spans {
            let names = &resource.resource.as_ref().unwrap().attributes;
            assert!(names.iter().any(|attribute| attribute.key == "service.name"));
            let of_scopes = resource.scope_spans.into_iter().flat_map(|scope| scope.spans);
            spans.extend(of_scopes.map(|span| (span.span_id.clone(), span)));
        }
    }
    let of_request = |id: &str| spans.values().find(|span| text(span, "id").as_deref() == Some(id)).unwrap();
    let request = of_request("story");
    assert_eq!((request.name.as_str(), request.parent_span_id.len()), ("request", 0));
    let joined = of_request("joined");
    assert_eq!(data_encoding::HEXLOWER.encode(&joined.trace_id), &caller[3..35]);
    assert_eq!(data_encoding::HEXLOWER.encode(&joined.parent_span_id), &caller[36..52]);
    assert_eq!(joined.trace_state, "a=1");
    let alone = of_request("alone");
    assert!(alone.parent_span_id.is_empty() && alone.trace_id != joined.trace_id);
    let of_story = |span: &&Span| span.name == "frame" && span.parent_span_id == request.span_id;
    let frame = spans.values().find(of_story).expect("a span of the frame");
    assert_eq!(text(request, "method").as_deref(), Some("GET"));
    assert!(frame.start_time_unix_nano >= request.start_time_unix_nano);
    assert!(frame.end_time_unix_nano <= request.end_time_unix_nano, "the answer came before the frame");
}

/// A collector that is not there costs a warning, and no picture.
#[test]
fn a_missing_collector_is_a_warning() {
    let folder = tempfile::tempdir().unwrap();
    let series = phantom(folder.path());
    let url = format!("http://{}", TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap());
    let arguments = ["serve", "--series", &series, "--listen", "127.0.0.1:0", "--traces", &url];
    let running = Running::spawn(&mut relief(&arguments));
    running.await_ready();
    let (status, log) = running.stop("TERM");
    assert_eq!(status, Some(0), "{log}");
    assert!(log.contains("WARN") || log.contains("ERROR"), "a lost trace is silent: {log}");
    let wrong = relief(&["serve", "--series", &series, "--listen", "127.0.0.1:0", "--traces", "nowhere"]);
    let output = { wrong }.output().unwrap();
    assert_eq!(output.status.code(), Some(1));
    assert!(String::from_utf8_lossy(&output.stderr).contains("--traces cannot be used"));
}
