# Lists the crates of a bill of materials (scripts/sbom, on stdin) with their licences, and the notices in their sources.
import hashlib
import json
import os
import re
import subprocess
import sys

NOTICE = re.compile(r"^(LICEN[CS]E|COPYING|COPYRIGHT|NOTICE|UNLICENSE)([-._].*)?$", re.IGNORECASE)
SKIPPED = {"target", "tests", "benches", "examples", ".git"}
DEPTH = 4  # folders below a crate's own where a C library may have its licence


def notices(folder):
    """The texts of the licences in a crate's source, sorted by path."""
    found = []
    for place, folders, files in os.walk(folder):
        below = os.path.relpath(place, folder)
        depth = 0 if below == "." else below.count(os.sep) + 1
        folders[:] = sorted(name for name in folders if name not in SKIPPED) if depth < DEPTH else []
        found += [os.path.join(place, name) for name in sorted(files) if NOTICE.match(name)]
    for path in found:
        with open(path, encoding="utf-8", errors="replace") as file:
            yield "\n".join(line.rstrip() for line in file.read().strip().splitlines())


def main():
    bill = json.load(sys.stdin)
    command = ["cargo", "metadata", "--locked", "--format-version", "1"]
    packages = json.loads(subprocess.run(command, check=True, capture_output=True).stdout)["packages"]
    sources = {(one["name"], one["version"]): os.path.dirname(one["manifest_path"]) for one in packages if one["source"]}
    texts, users = {}, {}
    print("Libraries that are linked into relief, with their licences. Their notices follow.\n")
    for one in bill["components"]:
        name = one["name"], one["version"]
        if name not in sources:
            continue  # a crate of Relief itself
        licence = one["licenses"][0]["expression"] if "licenses" in one else "see its notice"
        print(f"{name[0]} {name[1]}: {licence}")
        for text in notices(sources[name]):
            key = hashlib.sha256(" ".join(text.split()).encode()).hexdigest()
            texts.setdefault(key, text)
            users.setdefault(key, []).append(name[0])
    for key, text in texts.items():
        names = ", ".join(dict.fromkeys(users[key]))
        print(f"\n{'=' * 100}\nOf {names}:\n\n{text}")


main()
