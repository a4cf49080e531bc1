//! The findings of `relief doctor` about the child processes that read uploads.

use super::finding::{Finding, Mark};

/// Whether children of a server have no rights on this system, found by trying.
#[cfg(target_os = "linux")]
pub(super) fn isolation_finding() -> Finding {
    use relief_isolation::IsolatedReader;
    let tried = IsolatedReader::of_this_program()
        .map_err(|error| error.to_string())
        .and_then(|reader| reader.remaining_rights().map_err(|error| error.to_string()));
    match tried {
        Ok(rights) if rights.are_none() => {
            let found = "read in a child process without rights to files, network and programs".to_owned();
            Finding::new(Mark::Ok, WHAT, found)
        }
        Ok(rights) => {
            let found = format!("read in a child process that still {rights}");
            Finding::new(Mark::Warn, WHAT, found).advise([
                "use a kernel with Landlock and seccomp (Linux 5.13 and later, security=landlock), and a container that allows them",
            ])
        }
        Err(error) => {
            let found = format!("no child process can read them: {error}");
            Finding::new(Mark::Warn, WHAT, found)
                .advise(["relief serve --isolation off reads uploads in its own process; give them to callers you trust"])
        }
    }
}

/// Other systems have no such children.
#[cfg(not(target_os = "linux"))]
pub(super) fn isolation_finding() -> Finding {
    Finding::new(Mark::Warn, WHAT, "read in the server's own process: isolation needs Linux".to_owned())
}

const WHAT: &str = "uploads";
