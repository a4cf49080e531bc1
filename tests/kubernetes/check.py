# Reads manifests, checks them against Kubernetes' own schemas and what these do not say, and prints what containers run.
#
# usage: check.py FILE...
import json
import sys

import kubernetes_validate
import yaml


def expect(holds, what):
    if not holds:
        sys.exit(what)


def check_pod(where, pod):
    volumes = {volume["name"] for volume in pod["volumes"]}
    for container in pod["containers"]:
        mounts = {mount["name"] for mount in container["volumeMounts"]}
        expect(mounts <= volumes, f"{where}: mounts {mounts - volumes} of no volume")
        ports = {port["name"] for port in container.get("ports", [])}
        for probe in ("startupProbe", "readinessProbe", "livenessProbe"):
            if probe in container:
                expect(container[probe]["httpGet"]["port"] in ports, f"{where}: {probe} asks no port")
        expect("limits" in container["resources"], f"{where}: a container without a limit of memory")
        yield container


def check(where, document):
    kubernetes_validate.validate(document, kubernetes_validate.latest_version(), strict=True)
    if document["kind"] == "Service":
        return
    spec, template = document["spec"], document["spec"]["template"]
    labels = template["metadata"]["labels"]
    if document["kind"] == "Deployment":
        wanted = spec["selector"]["matchLabels"]
        expect(wanted.items() <= labels.items(), f"{where}: the selector finds no pod")
    containers = list(check_pod(where, template["spec"]))
    if document["kind"] == "Job":
        expect(spec["completionMode"] == "Indexed", f"{where}: no indexed job")
        expect(template["spec"]["restartPolicy"] == "Never", f"{where}: policies of failures want Never")
        names = {container["name"] for container in containers}
        for rule in spec["podFailurePolicy"]["rules"]:
            codes = rule.get("onExitCodes")
            expect(codes is None or codes["containerName"] in names, f"{where}: a rule for no container")
            expect(codes is None or 75 not in codes["values"], f"{where}: 75 is tried again")
        line = next(c["args"] for c in containers)
        share = line[line.index("--shard") + 1]
        expect(share == f"$(JOB_COMPLETION_INDEX)/{spec['completions']}", f"{where}: shares are not completions")
    for container in containers:
        yield {"file": where, "kind": document["kind"], "line": container["command"] + container["args"]}


lines = []
for path in sys.argv[1:]:
    with open(path) as file:
        for document in yaml.safe_load_all(file):
            lines += check(path, document)
json.dump(lines, sys.stdout)
