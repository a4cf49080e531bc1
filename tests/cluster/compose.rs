//! The compose file, read as YAML by a parser of its own, and its command lines by the program that
//! they are for.

use std::process::Command;

use serde_json::Value;

use crate::cluster::stage::{relief, root};

/// Converts a YAML file to JSON with a Python that has a YAML parser. Without one, prints a message
/// and returns `None`.
fn yaml(path: &str) -> Option<Value> {
    let script = "import json, sys, yaml; json.dump(yaml.safe_load(open(sys.argv[1])), sys.stdout)";
    let named = ["RELIEF_MANIFESTS_PYTHON", "RELIEF_PEERS_PYTHON"].into_iter().filter_map(std::env::var_os);
    for python in named.chain(["python3".into()]) {
        let read = Command::new(&python).args(["-c", script]).arg(root().join(path)).output();
        let Ok(read) = read else { continue };
        if read.status.success() {
            return Some(serde_json::from_slice(&read.stdout).unwrap());
        }
        let errors = String::from_utf8_lossy(&read.stderr);
        assert!(errors.contains("ModuleNotFoundError"), "{path}: {errors}");
    }
    eprintln!("SKIPPED: the compose file (no Python with a parser of YAML; scripts/setup-services gets one)");
    None
}

#[test]
fn the_compose_file_is_yaml_whose_parts_fit_together() {
    let Some(file) = yaml("scripts/compose/compose.yaml") else { return };
    let services = file["services"].as_object().unwrap();
    assert_eq!(
        services.keys().map(String::as_str).collect::<Vec<_>>(),
        ["nginx", "postgres", "server-1", "server-2"]
    );
    let nginx = services["nginx"]["environment"].as_object().unwrap();
    // The variables of the template are set, and no others.
    let template = std::fs::read_to_string(root().join("scripts/nginx/relief.conf.template")).unwrap();
    let mut wanted: Vec<&str> =
        template.split("${").skip(1).map(|rest| rest.split_once('}').unwrap().0).collect();
    wanted.sort_unstable();
    wanted.dedup();
    let mut given: Vec<&str> = nginx.keys().map(String::as_str).collect();
    given.sort_unstable();
    assert_eq!(wanted, given);
    for server in ["server-1", "server-2"] {
        assert!(nginx["RELIEF_SERVERS"].as_str().unwrap().contains(&format!("server {server}:8080 ")));
        let service = &services[server];
        let database = service["environment"]["RELIEF_ANNOTATIONS"].as_str().unwrap();
        let user = services["postgres"]["environment"]["POSTGRES_USER"].as_str().unwrap();
        let name = services["postgres"]["environment"]["POSTGRES_DB"].as_str().unwrap();
        assert!(
            database.starts_with(&format!("postgres://{user}:"))
                && database.ends_with(&format!("@postgres/{name}?sslmode=disable"))
        );
        // The program reads its command line, and misses nothing but the series of the container.
        let line: Vec<&str> = service["command"].as_str().unwrap().split_whitespace().collect();
        let run = relief(&line).output().unwrap();
        let errors = String::from_utf8_lossy(&run.stderr);
        assert_eq!(run.status.code(), Some(1), "{errors}");
        assert!(errors.contains("cannot read /series/head"), "{errors}");
    }
    for (name, service) in services {
        for mount in service["volumes"].as_array().into_iter().flatten() {
            let from = mount.as_str().unwrap().split(':').next().unwrap();
            if from.starts_with("..") {
                assert!(root().join("scripts/compose").join(from).exists(), "{name}: {from}");
            }
        }
        let dockerfile = service["build"]["dockerfile"].as_str();
        assert!(dockerfile.is_none_or(|path| root().join(path).exists()), "{name}: {dockerfile:?}");
        let on = &service["depends_on"];
        let listed = on.as_array().into_iter().flatten().map(|on| on.as_str().unwrap());
        let awaited = on.as_object().into_iter().flatten().map(|(on, _)| on.as_str());
        for on in listed.chain(awaited) {
            assert!(services.contains_key(on), "{name}: {on}");
        }
    }
}
