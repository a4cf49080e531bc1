"""Requests that Schemathesis generates from a server's own API description, and whether the answers follow it.

Schemathesis runs in an environment of its own, which scripts/torture sets up. All of its checks are on. Three statuses count as
refusals beside those that it knows: 413 (a body that is too large), 426 (no WebSocket) and 428 (a missing If-Match). A request
that follows the description may be answered with 422, because its parts contradict one another or name what the volume does not
have. Left out: the WebSocket, and a stream that never ends.
"""

import collections
import json
import subprocess

CONFIGURATION = """
[checks]
positive_data_acceptance.expected-statuses = ["2xx", "3xx", 401, 403, 404, 409, 413, 422, 428, 429, 503]
negative_data_rejection.expected-statuses = [400, 401, 403, 404, 405, 406, 409, 411, 413, 414, 415, 422, 426, 428, 429, 431]
missing_required_header.expected-statuses = [400, 401, 403, 406, 415, 422, 428]
"""
# Schemathesis has no serializer for zip files; the description says that the body is bytes.
HOOKS = """
import schemathesis

schemathesis.serializer.alias("application/zip", "application/octet-stream")
"""
LEFT_OUT = r"/mjpeg$|^/v1/session$"


def generate(schemathesis, server, folder, examples, token=None):
    """The statuses of all answers with their counts, and the findings as texts."""
    (folder / "schemathesis.toml").write_text(CONFIGURATION)
    (folder / "torture_hooks.py").write_text(HOOKS)
    events = folder / "events.ndjson"
    command = [schemathesis, "--config-file", "schemathesis.toml", "run", f"http://{server.host}:{server.port}/openapi.json"]
    command += ["--phases", "examples,coverage,fuzzing", "--checks", "all", "--continue-on-failure", "--seed", "1"]
    command += ["-n", str(examples), "-w", "1", "--request-timeout", "60", "--max-response-time", "40", "--exclude-path-regex", LEFT_OUT]
    command += ["--no-color", "--report-ndjson-path", str(events)]
    if token:
        command += ["-H", f"Authorization: Bearer {token}"]
    environment = {"SCHEMATHESIS_HOOKS": "torture_hooks", "PYTHONPATH": str(folder), "PATH": "/usr/bin:/bin"}
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)
    statuses, findings = read_events(events)
    if done.returncode not in (0, 1) or not statuses:
        findings.append(f"Schemathesis ended with status {done.returncode}: {done.stderr[-500:]} {done.stdout[-500:]}")
    return statuses, findings


def read_events(path):
    statuses, findings, finished = collections.Counter(), [], False
    for line in path.read_text().splitlines() if path.exists() else []:
        ((kind, event),) = json.loads(line).items()
        finished |= kind == "EngineFinished"
        if kind == "NonFatalError":
            findings.append(f"error of the tool: {json.dumps(event)[:300]}")
        if kind != "ScenarioFinished":
            continue
        recorder = event["recorder"]
        answers = {case: interaction.get("response") or {} for case, interaction in recorder.get("interactions", {}).items()}
        statuses.update(answer.get("status_code", "none") for answer in answers.values())
        for case, checks in recorder.get("checks", {}).items():
            for check in checks:
                if check.get("status") != "success":
                    body = json.dumps(answers.get(case, {}).get("content"))[:400]
                    findings.append(f"{recorder.get('label', '')}: {json.dumps(check)[:400]} {body}")
    if not finished:
        findings.append("Schemathesis did not end its run")
    return statuses, findings
