//! Rights of callers: tokens, sign-in, certificates, a proxy, TLS and the audit log, from outside.

use std::io::{Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::Output;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rustls::pki_types::pem::PemObject;
use rustls::pki_types::{CertificateDer, PrivateKeyDer, ServerName};

use super::{Running, phantom, relief};

/// A landmark, as a client sends it.
const LANDMARK: &str =
    r#"{"changes":[{"change":"create","item":{"name":"L1","geometry":{"kind":"point","at_mm":[0,0,0]}}}]}"#;

fn run(arguments: &[&str]) -> Output {
    relief(arguments).output().unwrap()
}

/// A token of this name and scope.
fn token(file: &str, name: &str, scope: &str) -> String {
    let made = run(&["token", "add", file, "--name", name, "--scope", scope, "--days", "1"]);
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    String::from_utf8(made.stdout).unwrap().trim().to_owned()
}

fn status_of(answer: &(String, Vec<u8>)) -> u16 {
    answer.0.split(' ').nth(1).and_then(|status| status.parse().ok()).expect("a status line")
}

impl Running {
    fn status(&self, line: &str, headers: &str, body: &[u8]) -> u16 {
        status_of(&self.ask(line, headers, body))
    }

    /// The status of a request with a token.
    fn by(&self, token: &str, line: &str, body: &str) -> u16 {
        let json = if body.is_empty() { "" } else { "Content-Type: application/json\r\n" };
        let headers = format!("Authorization: Bearer {token}\r\n{json}Content-Length: {}\r\n", body.len());
        self.status(line, &headers, body.as_bytes())
    }

    /// The answer to a page that exchanges a token for a cookie.
    fn sign_in(&self, token: &str, headers: &str) -> (String, Vec<u8>) {
        let body = format!("{{\"token\":\"{token}\"}}");
        let headers =
            format!("{headers}Content-Type: application/json\r\nContent-Length: {}\r\n", body.len());
        self.ask("POST /v1/sign-in", &headers, body.as_bytes())
    }

    fn first_volume(&self, token: &str) -> String {
        let headers = format!("Authorization: Bearer {token}\r\n");
        let listed = self.ask("GET /v1/volumes", &headers, &[]).1;
        let listed: serde_json::Value = serde_json::from_slice(&listed).unwrap();
        listed["volumes"][0]["id"].as_str().expect("a volume").to_owned()
    }

    /// The status of an upgrade to a WebSocket.
    fn upgrade(&self, path: &str, headers: &str) -> u16 {
        let mut stream = TcpStream::connect(&self.address).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        write!(
            stream,
            "GET {path} HTTP/1.1\r\nHost: {}\r\nConnection: Upgrade\r\nUpgrade: websocket\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\
             Sec-WebSocket-Protocol: relief.v1\r\n{headers}\r\n",
            self.address
        )
        .unwrap();
        let mut head = [0; 12];
        stream.read_exact(&mut head).unwrap();
        std::str::from_utf8(&head[9..]).unwrap().parse().unwrap()
    }
}

/// Invariant: A server that other machines reach does not start without a means to recognise callers,
/// unless an option allows it.
#[test]
fn a_server_for_other_machines_asks_who_calls() {
    let refused = run(&["serve", "--listen", "0.0.0.0:0"]);
    let text = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert_eq!(refused.status.code(), Some(1), "{text}");
    assert!(text.contains("--token-file") && text.contains("--insecure"), "{text}");
    let missing = run(&["serve", "--token-file", "/nowhere/tokens"]);
    assert!(!missing.status.success(), "a token file that is missing admits nobody");
}

/// Invariant: A token allows what its scope allows and nothing else. Its name is the author of its
/// holder's edits. A removed token is refused within seconds.
#[test]
fn tokens_have_scopes_and_name_the_author() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (file, log, audit) = (path("tokens"), path("log.db"), path("audit.log"));
    let (vera, anna) = (token(&file, "vera", "view"), token(&file, "Anna Ä.", "annotate"));
    let root = token(&file, "root", "admin");
    let series = phantom(folder.path());
    let arguments = ["serve", "--series", &series, "--annotations", &log, "--listen", "127.0.0.1:0"];
    let known = ["--token-file", &file, "--audit-log", &audit, "--probe-listen", "127.0.0.1:0"];
    let running = Running::spawn(&mut relief(&[&arguments[..], &known].concat()));
    running.await_ready();

    // Without a token: health and the way to sign in, nothing else.
    let (head, _) = running.ask("GET /v1/volumes", "", &[]);
    assert!(head.starts_with("HTTP/1.1 401") && head.contains("www-authenticate: Bearer"), "{head}");
    let (head, _) = running.ask("GET /annotate", "", &[]);
    assert!(head.starts_with("HTTP/1.1 303") && head.contains("location: /sign-in?next=/annotate"), "{head}");
    for open in ["/healthz", "/readyz", "/sign-in", "/sign-in.js", "/openapi.json", "/v1/identity"] {
        assert_eq!(running.status(&format!("GET {open}"), "", &[]), 200, "{open}");
    }
    for closed in ["/metrics", "/v1/presets", "/v1/session", "/studies/1/series/2/rendered3D"] {
        assert_eq!(running.status(&format!("GET {closed}"), "", &[]), 401, "{closed}");
    }
    assert_eq!(running.by("relief_wrong", "GET /v1/volumes", ""), 401);

    // Scopes.
    let id = running.first_volume(&vera);
    let items = format!("/v1/volumes/{id}/annotations");
    let (add, remove) = (format!("POST {items}"), format!("DELETE /v1/volumes/{id}"));
    assert_eq!(running.by(&vera, &format!("GET /v1/volumes/{id}/frame?layout=color&size_px=64,64"), ""), 200);
    assert_eq!(running.by(&vera, &format!("POST /v1/volumes/{id}/pick?u=8&v=8"), "{}"), 200);
    assert_eq!(running.by(&vera, &add, LANDMARK), 403);
    assert_eq!(running.by(&anna, &add, LANDMARK), 201);
    assert_eq!(running.by(&anna, &remove, ""), 403);
    let forbidden = |token: &str| {
        let headers = format!("Authorization: Bearer {token}\r\n");
        let answer = running.ask(&remove, &headers, &[]).1;
        serde_json::from_slice::<serde_json::Value>(&answer).unwrap()["code"].clone()
    };
    assert_eq!((forbidden(&anna), forbidden(&root)), ("scope".into(), "not-removable".into()));

    // The author is the token's name: another one is refused wherever it may stand.
    let other = LANDMARK.replacen('{', "{\"author\":\"eve\",", 1);
    assert_eq!(running.by(&anna, &add, &other), 403);
    assert_eq!(running.by(&anna, &format!("GET {items}?author=eve"), ""), 403);
    let headers = format!("Authorization: Bearer {anna}\r\nRelief-Author: eve\r\n");
    assert_eq!(running.status(&format!("GET {items}"), &headers, &[]), 403);
    let listed = running.ask(&format!("GET {items}"), &format!("Authorization: Bearer {vera}\r\n"), &[]).1;
    let listed: serde_json::Value = serde_json::from_slice(&listed).unwrap();
    assert_eq!(listed["items"][0]["item"]["author"], "Anna Ä.", "{listed}");

    // A removed token is refused; the others stay.
    assert!(run(&["token", "remove", &file, "--name", "vera"]).status.success());
    let since = Instant::now();
    while running.by(&vera, "GET /v1/volumes", "") != 401 {
        assert!(since.elapsed() < Duration::from_secs(60), "a removed token is still accepted");
        std::thread::sleep(Duration::from_millis(100));
    }
    assert_eq!(running.by(&anna, "GET /v1/volumes", ""), 200);
    let (code, said) = running.stop("TERM");
    assert_eq!(code, Some(0), "{said}");
    check_audit(&audit, &id);
}

/// The log has each request and its outcome, and shows a change of any byte.
fn check_audit(audit: &str, id: &str) {
    let text = std::fs::read_to_string(audit).unwrap();
    let records: Vec<serde_json::Value> =
        text.lines().map(|line| serde_json::from_str(line.split_once(' ').unwrap().1).unwrap()).collect();
    let count = |who: Option<&str>, status: u16| {
        let who = who.map_or(serde_json::Value::Null, Into::into);
        records.iter().filter(|record| record["who"] == who && record["status"] == status).count()
    };
    assert!(count(None, 401) >= 5 && count(Some("vera"), 200) >= 3 && count(Some("vera"), 403) == 1);
    assert_eq!(count(Some("Anna Ä."), 201), 1);
    assert!(records.iter().any(|record| record["volume"] == id && record["method"] == "DELETE"));
    let whole = run(&["audit", audit, "--json"]);
    let whole: serde_json::Value = serde_json::from_slice(&whole.stdout).unwrap();
    assert_eq!(whole["records"], records.len());
    let head = whole["head"].as_str().unwrap();
    assert!(run(&["audit", audit, "--contains", head]).status.success());
    // The last record is removed: the chain is whole, but the kept hash is missing.
    let cut: String = text.lines().take(records.len() - 1).map(|line| line.to_owned() + "\n").collect();
    std::fs::write(audit, cut).unwrap();
    assert!(run(&["audit", audit]).status.success());
    assert!(!run(&["audit", audit, "--contains", head]).status.success());
    std::fs::write(audit, text.replacen("\"status\":403", "\"status\":200", 1)).unwrap();
    let changed = run(&["audit", audit]);
    let said = String::from_utf8_lossy(&changed.stderr).into_owned();
    assert!(!changed.status.success() && said.contains("line"), "{said}");
}

/// Invariant: A page signs in by a token and gets a cookie; a cookie alone opens no WebSocket, and a
/// ticket opens one.
#[test]
fn pages_sign_in_and_open_sockets_by_tickets() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("tokens").to_str().unwrap().to_owned();
    let anna = token(&file, "anna", "annotate");
    let series = phantom(folder.path());
    let arguments = ["serve", "--series", &series, "--listen", "127.0.0.1:0", "--token-file", &file];
    let running = Running::spawn(&mut relief(&arguments));
    running.await_ready();
    assert_eq!(status_of(&running.sign_in("relief_wrong", "")), 401);
    let (head, _) = running.sign_in(&anna, "X-Forwarded-Proto: https\r\n");
    assert!(head.contains("; Secure"), "a proxy encrypts: {head}");
    let (head, _) = running.sign_in(&anna, "");
    let cookie = head.lines().find_map(|line| line.strip_prefix("set-cookie: ")).expect("a cookie");
    assert!(cookie.contains("HttpOnly") && cookie.contains("SameSite=Strict"), "{cookie}");
    let cookie = format!("Cookie: {}\r\n", cookie.split(';').next().unwrap());
    assert_eq!(running.status("GET /", &cookie, &[]), 200);
    assert_eq!(running.status("GET /v1/volumes", &cookie, &[]), 200);
    let identity = running.ask("GET /v1/identity", &cookie, &[]).1;
    let identity: serde_json::Value = serde_json::from_slice(&identity).unwrap();
    assert_eq!((&identity["name"], &identity["scope"]), (&"anna".into(), &"annotate".into()));

    assert_eq!(running.upgrade("/v1/session", &cookie), 401);
    assert_eq!(running.upgrade("/v1/session", &format!("Authorization: Bearer {anna}\r\n")), 101);
    let ticket = running.ask("POST /v1/session/ticket", &format!("{cookie}Content-Length: 0\r\n"), &[]).1;
    let ticket: serde_json::Value = serde_json::from_slice(&ticket).unwrap();
    let path = format!("/v1/session?ticket={}", ticket["ticket"].as_str().unwrap());
    assert_eq!(running.upgrade(&path, ""), 101);
    assert_eq!(running.upgrade(&path, ""), 401, "a ticket opens one socket");

    let (head, _) = running.ask("POST /v1/sign-out", &format!("{cookie}Content-Length: 0\r\n"), &[]);
    assert!(
        head.contains("204") && head.contains("relief_sign_in=; ") && head.contains("Max-Age=0"),
        "{head}"
    );
}

/// An answer over TLS by a client of its own; `None` when the handshake fails.
fn ask_encrypted(
    address: &str,
    authority: &Path,
    identity: Option<(Vec<CertificateDer<'static>>, PrivateKeyDer<'static>)>,
) -> Option<String> {
    let mut roots = rustls::RootCertStore::empty();
    roots.add(CertificateDer::from_pem_file(authority).unwrap()).unwrap();
    let provider = Arc::new(rustls::crypto::ring::default_provider());
    let builder = rustls::ClientConfig::builder_with_provider(provider)
        .with_safe_default_protocol_versions()
        .unwrap()
        .with_root_certificates(roots);
    let config = match identity {
        None => builder.with_no_client_auth(),
        Some((chain, key)) => builder.with_client_auth_cert(chain, key).unwrap(),
    };
    let name = ServerName::try_from("localhost").unwrap();
    let connection = rustls::ClientConnection::new(Arc::new(config), name).unwrap();
    let socket = TcpStream::connect(address).unwrap();
    socket.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    let mut stream = rustls::StreamOwned::new(connection, socket);
    let request = format!("GET /v1/identity HTTP/1.1\r\nHost: {address}\r\nConnection: close\r\n\r\n");
    stream.write_all(request.as_bytes()).ok()?;
    let mut answer = Vec::new();
    let _ = stream.read_to_end(&mut answer);
    Some(String::from_utf8_lossy(&answer).into_owned()).filter(|answer| !answer.is_empty())
}

/// Invariant: An encrypted server shows its picture to a client that trusts its certificate, takes a
/// new certificate without a restart, and tells a client that does not trust it what to do.
#[test]
fn an_encrypted_server_serves_the_client_that_trusts_it() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (file, tls, picture) = (path("tokens"), path("tls"), path("frame.png"));
    let anna = token(&file, "anna", "view");
    let series = phantom(folder.path());
    let arguments = ["serve", "--series", &series, "--listen", "127.0.0.1:0", "--listen-when-loaded"];
    let known = ["--token-file", &file, "--tls-self-signed", &tls];
    let running = Running::spawn(&mut relief(&[&arguments[..], &known].concat()));
    let server = format!("https://{}", running.address);
    let certificate = path("tls/relief-certificate.pem");
    let client = |more: &[&str]| {
        let arguments = ["client", "--server", &server, "--headless", "--layout", "color", "--size", "64x64"];
        relief(&[&arguments, more].concat()).env("RELIEF_TOKEN", &anna).output().unwrap()
    };
    let saved = client(&["--ca", &certificate, "--save-frame", &picture]);
    assert!(saved.status.success(), "{}", String::from_utf8_lossy(&saved.stderr));
    assert!(std::fs::metadata(&picture).unwrap().len() > 100);
    let stranger = client(&["--save-frame", &picture]);
    let said = String::from_utf8_lossy(&stranger.stderr).into_owned();
    assert!(!stranger.status.success() && said.contains("--ca"), "{said}");

    // A new certificate in the same files is used without a restart.
    let earlier = Path::new(&certificate).with_extension("old");
    std::fs::copy(&certificate, &earlier).unwrap();
    let made = rcgen::generate_simple_self_signed(vec!["localhost".to_owned()]).unwrap();
    std::fs::write(path("tls/relief-key.pem"), made.signing_key.serialize_pem()).unwrap();
    std::fs::write(&certificate, made.cert.pem()).unwrap();
    let since = Instant::now();
    while ask_encrypted(&running.address, Path::new(&certificate), None).is_none() {
        assert!(since.elapsed() < Duration::from_secs(60), "the new certificate is not used");
        std::thread::sleep(Duration::from_millis(200));
    }
    assert_eq!(ask_encrypted(&running.address, &earlier, None), None);
}

/// Invariant: A client certificate of the trusted authority names its holder; without one there is no
/// connection.
#[test]
fn a_client_certificate_names_its_holder() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (authority, tls) = (path("authority.pem"), path("tls"));
    let authority_key = rcgen::KeyPair::generate().unwrap();
    let mut parameters = rcgen::CertificateParams::default();
    parameters.is_ca = rcgen::IsCa::Ca(rcgen::BasicConstraints::Unconstrained);
    std::fs::write(&authority, parameters.self_signed(&authority_key).unwrap().pem()).unwrap();
    let issuer = rcgen::Issuer::new(parameters, authority_key);
    let carol_key = rcgen::KeyPair::generate().unwrap();
    let mut carol = rcgen::CertificateParams::default();
    carol.distinguished_name.push(rcgen::DnType::CommonName, "carol");
    let carol = carol.signed_by(&carol_key, &issuer).unwrap();

    let arguments = ["serve", "--listen", "127.0.0.1:0", "--tls-self-signed", &tls];
    let more = ["--tls-client-ca", &authority, "--tls-client-scope", "admin"];
    let running = Running::spawn(&mut relief(&[&arguments[..], &more].concat()));
    let certificate = folder.path().join("tls/relief-certificate.pem");
    let key = PrivateKeyDer::try_from(carol_key.serialize_der()).unwrap();
    let answer =
        ask_encrypted(&running.address, &certificate, Some((vec![carol.der().clone()], key))).unwrap();
    assert!(answer.contains("\"carol\"") && answer.contains("\"admin\""), "{answer}");
    assert_eq!(ask_encrypted(&running.address, &certificate, None), None);
}

/// Invariant: The header of a proxy names callers only if the connection comes from the proxy.
#[test]
fn only_a_trusted_proxy_names_callers() {
    let arguments = ["serve", "--listen", "127.0.0.1:0", "--proxy-scope", "view", "--trusted-proxy"];
    let named = "X-Forwarded-User: ren%C3%A9e\r\n";
    let running = Running::spawn(&mut relief(&[&arguments[..], &["127.0.0.1"]].concat()));
    assert_eq!(running.status("GET /v1/volumes", named, &[]), 200);
    assert_eq!(running.status("GET /v1/volumes", "", &[]), 401);
    let identity = running.ask("GET /v1/identity", named, &[]).1;
    assert!(String::from_utf8(identity).unwrap().contains("renée"));
    // The client sends the proxy's header too.
    let two = format!("X-Forwarded-User: eve\r\n{named}");
    assert_eq!(running.status("GET /v1/volumes", &two, &[]), 401);
    let identity = running.ask("GET /v1/identity", &two, &[]).1;
    let identity: serde_json::Value = serde_json::from_slice(&identity).unwrap();
    assert_eq!(identity["name"], serde_json::Value::Null);
    assert!(identity["problem"].as_str().unwrap().contains("several headers"), "{identity}");
    let running = Running::spawn(&mut relief(&[&arguments[..], &["192.0.2.1"]].concat()));
    assert_eq!(running.status("GET /v1/volumes", named, &[]), 401);
}

/// Invariant: Slow sign-ins do not delay other requests. The server reads at most 16 at a time, each for at
/// most 5 seconds. The audit log records or counts every attempt.
#[test]
fn strangers_who_sign_in_slowly_delay_nobody() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (file, audit) = (path("tokens"), path("audit.log"));
    let root = token(&file, "root", "admin");
    let arguments = ["serve", "--listen", "127.0.0.1:0", "--token-file", &file, "--audit-log", &audit];
    let running = Running::spawn(&mut relief(&arguments));
    assert_eq!(status_of(&running.sign_in("relief_guess", "")), 401);
    let head = "POST /v1/sign-in HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: 4000\r\n\r\n{";
    // The server accepts 256 connections.
    let strangers: Vec<TcpStream> = (0..256)
        .map(|_| {
            let mut stranger = TcpStream::connect(&running.address).unwrap();
            stranger.write_all(head.as_bytes()).unwrap();
            stranger
        })
        .collect();
    let since = Instant::now();
    assert_eq!(running.by(&root, "GET /v1/volumes", ""), 200);
    // The limits are 5 s for a body and 20 s for an idle connection.
    assert!(since.elapsed() < Duration::from_secs(15), "{:?}", since.elapsed());
    let mut statuses = std::collections::BTreeMap::<u16, usize>::new();
    for mut stranger in strangers {
        stranger.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
        let mut answer = [0; 12];
        // The server may have closed the connection to make room for another one.
        if stranger.read_exact(&mut answer).is_ok() {
            *statuses.entry(std::str::from_utf8(&answer[9..]).unwrap().parse().unwrap()).or_default() += 1;
        }
    }
    assert!(
        statuses[&408] <= 16 && statuses.keys().all(|status| [408, 429].contains(status)),
        "{statuses:?}"
    );
    let (code, said) = running.stop("TERM");
    assert_eq!(code, Some(0), "{said}");
    let text = std::fs::read_to_string(&audit).unwrap();
    assert!(text.lines().filter(|line| line.contains("/v1/sign-in")).count() > 16, "{text}");
    assert!(text.contains("\"status\":401") && !text.contains("relief_guess"), "{text}");
}

/// Invariant: While the token file is damaged or missing, no token is accepted. When it can be read again,
/// its tokens are accepted.
#[test]
fn a_damaged_token_file_accepts_nobody() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("tokens").to_str().unwrap().to_owned();
    let (anna, root) = (token(&file, "anna", "annotate"), token(&file, "root", "admin"));
    let running = Running::spawn(&mut relief(&["serve", "--listen", "127.0.0.1:0", "--token-file", &file]));
    let whole = std::fs::read_to_string(&file).unwrap();
    let without_anna: String =
        whole.lines().filter(|line| !line.contains("anna")).map(|line| format!("{line}\n")).collect();
    let until = |token: &str, status: u16| {
        let since = Instant::now();
        while running.by(token, "GET /v1/volumes", "") != status {
            assert!(since.elapsed() < Duration::from_secs(60), "no {status}");
            std::thread::sleep(Duration::from_millis(100));
        }
    };
    until(&anna, 200);
    std::fs::write(&file, format!("{without_anna}a damaged line\n")).unwrap();
    until(&anna, 401);
    assert_eq!(running.by(&root, "GET /v1/volumes", ""), 401);
    std::fs::write(&file, &without_anna).unwrap();
    until(&root, 200);
    assert_eq!(running.by(&anna, "GET /v1/volumes", ""), 401);
    std::fs::remove_file(&file).unwrap();
    until(&root, 401);
    let (_, said) = running.stop("TERM");
    assert!(said.contains("no token is accepted until it can"), "{said}");
}

/// Invariant: An upload that does not end delays no upload of another caller.
#[test]
fn a_caller_has_one_upload_at_a_time() {
    let folder = tempfile::tempdir().unwrap();
    let tokens = folder.path().join("tokens").to_str().unwrap().to_owned();
    let (anna, ben) = (token(&tokens, "anna", "admin"), token(&tokens, "ben", "admin"));
    let listen = ["serve", "--listen", "127.0.0.1:0", "--token-file", &tokens];
    let running = Running::spawn(&mut relief(&listen));
    let upload = |token: &str| {
        let headers = format!(
            "Authorization: Bearer {token}\r\nContent-Type: application/zip\r\nContent-Length: 4\r\n"
        );
        running.status("POST /v1/volumes", &headers, b"none")
    };
    assert_eq!(upload(&anna), 422, "it is no zip");
    let mut slow = TcpStream::connect(&running.address).unwrap();
    let head = format!(
        "POST /v1/volumes HTTP/1.1\r\nHost: {}\r\nAuthorization: Bearer {anna}\r\n\
         Content-Type: application/zip\r\nContent-Length: 1000\r\nExpect: 100-continue\r\n\r\n",
        running.address
    );
    slow.write_all(head.as_bytes()).unwrap();
    // The server asks for the body once the upload has its place.
    let mut asked = [0; 12];
    slow.set_read_timeout(Some(Duration::from_secs(60))).unwrap();
    slow.read_exact(&mut asked).unwrap();
    assert_eq!(&asked, b"HTTP/1.1 100");
    assert_eq!(upload(&anna), 429);
    assert_eq!(upload(&ben), 422);
    drop(slow);
    let patience = Instant::now() + Duration::from_secs(60);
    while upload(&anna) != 422 {
        assert!(Instant::now() < patience, "the place of an upload that was given up stays taken");
    }
}
