//! Tests of the chain, of recovery from failures, and of the limit for refused requests.

use std::fs::OpenOptions;
use std::io::Write;
use std::time::{Duration, Instant};

use super::record::parse;
use super::*;

fn verify(path: &Path) -> Result<AuditSummary, AuditError> {
    verify_audit_log(&[path.to_owned()], None)
}

/// Records a request with this answer.
fn add(log: &Arc<AuditLog>, status: u16) {
    let uri: Uri = "/v1/volumes/0a1b/frame?preset=bone".parse().unwrap();
    let subject = Subject::of(&Method::GET, "/v1/volumes/{id}/frame", &uri);
    Arc::clone(log).begin(Caller::default(), subject).answered(status);
}

/// Waits until the condition holds.
fn wait(what: &str, mut holds: impl FnMut() -> bool) {
    let since = Instant::now();
    while !holds() {
        assert!(since.elapsed() < Duration::from_secs(60), "{what}");
        std::thread::sleep(Duration::from_millis(20));
    }
}

fn log_three(path: &Path) {
    let log = Arc::new(AuditLog::open(path).unwrap());
    [200, 403, 200].into_iter().for_each(|status| add(&log, status));
}

#[test]
fn a_chain_goes_on_after_a_restart_and_breaks_where_a_line_was_changed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("audit.log");
    log_three(&path);
    log_three(&path);
    let summary = verify(&path).unwrap();
    assert_eq!((summary.records, summary.torn), (6, 0));
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains("\"volume\":\"0a1b\"") && !text.contains("bone"));
    assert!(text.lines().last().unwrap().starts_with(&summary.head));
    let lines: Vec<&str> = text.lines().collect();
    let rest = |range: &[usize]| range.iter().map(|at| lines[*at].to_owned() + "\n").collect::<String>();
    for (changed, line) in [
        (text.replacen("\"status\":403", "\"status\":200", 1), 2),
        (rest(&[0, 2, 3]), 2),
        (rest(&[1, 2]), 1),
        (rest(&[0, 2, 1]), 2),
    ] {
        std::fs::write(&path, changed).unwrap();
        let error = verify(&path).unwrap_err();
        assert!(matches!(error, AuditError::Broken { line: at, .. } if at == line), "{error}");
    }
}

#[test]
fn a_request_whose_client_leaves_is_recorded_without_a_status() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("audit.log");
    let log = Arc::new(AuditLog::open(&path).unwrap());
    let uri: Uri = "/v1/volumes/0a1b/annotations".parse().unwrap();
    let subject = Subject::of(&Method::POST, "/v1/volumes/{id}/annotations", &uri);
    drop(Arc::clone(&log).begin(Caller::default(), subject));
    drop(log);
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.contains("\"POST\"") && !text.contains("status"), "{text}");
    assert_eq!(verify(&path).unwrap().records, 1);
}

#[test]
fn a_line_cut_off_by_a_crash_is_kept_and_named() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("audit.log");
    log_three(&path);
    let mut file = OpenOptions::new().append(true).open(&path).unwrap();
    file.write_all(b"0123 {\"previ").unwrap();
    log_three(&path);
    let summary = verify(&path).unwrap();
    assert_eq!((summary.records, summary.torn), (7, 1));
    let open = AuditLog::open(&path).unwrap();
    assert!(matches!(AuditLog::open(&path), Err(AuditError::InUse(_))));
    drop(open);
}

/// Invariant: A changed last line of an audit log is reported as a change and not taken for a crash.
#[test]
fn a_changed_last_record_is_no_crash() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("audit.log");
    log_three(&path);
    let text = std::fs::read_to_string(&path).unwrap();
    let (before, last) = text.trim_end().rsplit_once('\n').unwrap();
    let changed = last.replace("200", "404");
    for (replaced, line) in [(format!("{changed}\n"), 3), (changed, 3), ("anything\n".to_owned(), 3)] {
        std::fs::write(&path, format!("{before}\n{replaced}")).unwrap();
        let error = verify(&path).unwrap_err();
        assert!(matches!(error, AuditError::Broken { line: at, .. } if at == line), "{replaced}: {error}");
    }
    // A crash can cut the last line off at any byte. The log stays valid and can be continued.
    for length in 1..=last.len() {
        std::fs::write(&path, format!("{before}\n{}", &last[..length])).unwrap();
        let is_whole = length == last.len();
        let torn = u64::from(!is_whole);
        let summary = verify(&path).unwrap();
        assert_eq!((summary.records, summary.torn), (2 + u64::from(is_whole), torn), "cut at {length}");
        if length % 40 == 0 || is_whole {
            log_three(&path);
            let summary = verify(&path).unwrap();
            // One record states that a line is incomplete; it counts as a record itself.
            assert_eq!((summary.records, summary.torn), (6, torn), "cut at {length}");
        }
    }
}

/// Invariant: A limited number of refused requests is recorded in a minute; the log counts the others.
#[test]
fn refused_requests_are_sampled_and_counted() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("audit.log");
    let log = Arc::new(AuditLog::open(&path).unwrap());
    (0..5000).for_each(|_| add(&log, 401));
    add(&log, 200);
    (0..50).for_each(|_| add(&log, 429));
    drop(log);
    let summary = verify(&path).unwrap();
    let own = Refusals::PER_MINUTE;
    // A new minute may begin during the test.
    assert!((own + 2..=2 * own + 2).contains(&summary.records), "{summary:?}");
    assert_eq!(summary.records - 2 + summary.refused, 5050, "a record each, or counted: {summary:?}");
}

/// Invariant: If an audit log is removed, moved or emptied, the server continues it in a new file, which
/// begins with the hash of the last record of the old one.
#[test]
fn a_removed_log_is_made_again_and_names_the_one_before() {
    let folder = tempfile::tempdir().unwrap();
    let (path, moved) = (folder.path().join("audit.log"), folder.path().join("moved.log"));
    log_three(&path);
    let log = Arc::new(AuditLog::open(&path).unwrap());
    assert!(log.is_kept());
    std::fs::rename(&path, &moved).unwrap();
    assert!(!log.is_kept(), "a request is refused before its record would be lost");
    wait("a new file", || log.is_kept());
    add(&log, 200);
    wait("its record", || std::fs::read_to_string(&path).is_ok_and(|text| text.lines().count() == 2));
    let head = verify(&moved).unwrap().head;
    let error = verify(&path).unwrap_err();
    assert!(matches!(&error, AuditError::Continued { previous, .. } if *previous == head), "{error}");
    let both = verify_audit_log(&[moved.clone(), path.clone()], None).unwrap();
    assert_eq!((both.records, both.lost), (5, 0));
    // Emptied in place.
    std::fs::copy(&path, folder.path().join("second.log")).unwrap();
    OpenOptions::new().write(true).open(&path).unwrap().set_len(0).unwrap();
    add(&log, 200);
    drop(log);
    let files = [moved, folder.path().join("second.log"), path];
    assert_eq!(verify_audit_log(&files, None).unwrap().records, 7);
}

/// Invariant: Records that cannot be written are kept and written later.
#[test]
fn records_wait_until_the_disk_takes_them() {
    let folder = tempfile::tempdir().unwrap();
    let place = folder.path().join("logs");
    std::fs::create_dir(&place).unwrap();
    let path = place.join("audit.log");
    let log = Arc::new(AuditLog::open(&path).unwrap());
    let hidden = folder.path().join("hidden");
    std::fs::rename(&place, &hidden).unwrap();
    assert!(!log.is_kept());
    (0..3).for_each(|_| add(&log, 200));
    std::thread::sleep(Duration::from_millis(100));
    assert!(!log.is_kept(), "the folder is not there");
    std::fs::rename(&hidden, &place).unwrap();
    wait("the log is back", || log.is_kept());
    drop(log);
    let summary = verify(&path).unwrap();
    assert_eq!((summary.records, summary.lost), (3, 0), "{summary:?}");
    let text = std::fs::read_to_string(&path).unwrap();
    assert!(text.lines().all(|line| parse(line.as_bytes()).is_some()), "{text}");
}
