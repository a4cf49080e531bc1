"""Attacks and faults against a running server, and the figures of honest clients; see scripts/torture.

Each scenario prints its figures as lines of a table: the quantity, the figure, and the bar. Clients are plain sockets of
this program, so that nothing of Relief's own stands on both sides. Times in seconds, memory in MiB.
"""

import argparse
import asyncio
import json
import multiprocessing
import os
import random
import re
import signal
import sqlite3
import statistics
import subprocess
import sys
import tempfile
import time
import zipfile
import zlib
from pathlib import Path

from description import generate
from malformed import Slice, render_all

ROWS = []


def row(scenario, what, figure, bar, holds):
    """A line of the table."""
    ROWS.append((scenario, what, figure, bar, holds))
    print(f"torture: {scenario}: {what}: {figure} (bar: {bar}) {'ok' if holds else 'MISSED'}", file=sys.stderr, flush=True)


class Server:
    """A server process on a free port of the loopback."""

    def __init__(self, program, *arguments, port=0, quiet=True):
        command = [program, "serve", "--listen", f"127.0.0.1:{port}", *map(str, arguments)]
        errors = subprocess.DEVNULL if quiet else None
        self.since = time.monotonic()
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=errors, text=True)
        line = self.process.stdout.readline()
        found = re.search(r"//([\d.]+):(\d+)/", line)
        if not found:
            raise RuntimeError(f"the server does not listen: {line!r}")
        self.host, self.port = found[1], int(found[2])
        self.listening = time.monotonic() - self.since

    def rss(self):
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s*(\d+)", status)[1]) / 1024

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def terminate(self):
        """Seconds from SIGTERM to the exit."""
        since = time.monotonic()
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(60)
        return time.monotonic() - since


async def ask(server, line, headers="", body=b"", patience=60.0):
    """Status, headers and body of a request by a connection of its own."""

    async def whole():
        reader, writer = await asyncio.open_connection(server.host, server.port)
        try:
            length = f"Content-Length: {len(body)}\r\n" if body else ""
            head = f"{line} HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n{length}{headers}\r\n"
            writer.write(head.encode() + body)
            await writer.drain()
            answer = await reader.read()
        finally:
            writer.close()
        head, _, rest = answer.partition(b"\r\n\r\n")
        if not head.startswith(b"HTTP/1.1 "):
            raise ConnectionError("no answer")
        return int(head.split(b" ", 2)[1]), head.decode("latin-1").lower(), rest

    return await asyncio.wait_for(whole(), patience)


def png_size(data):
    """Width and height of a PNG whose chunks and pixels are whole."""
    assert data.startswith(b"\x89PNG\r\n\x1a\n"), "no PNG"
    at, pixels, size, ended = 8, b"", None, False
    while at < len(data):
        length, kind = int.from_bytes(data[at : at + 4]), data[at + 4 : at + 8]
        chunk = data[at + 8 : at + 8 + length]
        assert zlib.crc32(kind + chunk) == int.from_bytes(data[at + 8 + length : at + 12 + length]), "a damaged chunk"
        if kind == b"IHDR":
            size = int.from_bytes(chunk[:4]), int.from_bytes(chunk[4:8])
            channels = {0: 1, 2: 3, 6: 4}[chunk[9]]
        pixels += chunk if kind == b"IDAT" else b""
        ended |= kind == b"IEND"
        at += 12 + length
    assert ended and len(zlib.decompress(pixels)) == size[1] * (1 + size[0] * channels), "pixels are missing"
    return size


def quantile(values, share):
    ordered = sorted(values)
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))] if ordered else float("nan")


def wait_ready(server, path="/readyz", patience=120):
    async def ready():
        while True:
            try:
                if (await ask(server, f"GET {path}", patience=5))[0] == 200:
                    return
            except (OSError, TimeoutError, ConnectionError):
                pass
            await asyncio.sleep(0.02)

    asyncio.run(asyncio.wait_for(ready(), patience))


def first_volume(server, headers=""):
    listed = json.loads(asyncio.run(ask(server, "GET /v1/volumes", headers))[2])
    return listed["volumes"][0]["id"]


# ---------------------------------------------------------------- many clients


async def honest(server, frame, headers, until, counts):
    """A display that asks for a small frame every few seconds, and takes all of it."""
    await asyncio.sleep(random.uniform(0, 5))
    while time.monotonic() < until:
        since = time.monotonic()
        try:
            status, head, body = await ask(server, f"GET {frame}&azimuth_deg={random.randrange(3600) / 10}", headers)
            if status == 200:
                counts["times"].append(time.monotonic() - since)
                png_size(body)
            elif status in (429, 503) and "retry-after" in head:
                counts["put_off"] += 1
            else:
                counts["wrong"].append(f"status {status}")
        except (OSError, TimeoutError, ConnectionError, AssertionError, zlib.error) as error:
            counts["wrong"].append(f"{type(error).__name__}: {error}")
        await asyncio.sleep(random.uniform(3, 7))


async def hostile(server, frame, headers, number, until):
    """A client that is slow, silent, malformed or rude, one way after the other. It has a token."""
    ways = [slow_head, silent, malformed, slow_reader, large_frame, vanishing, slow_upload, flood]
    while time.monotonic() < until:
        way = ways[number % len(ways)]
        number += 1
        try:
            await asyncio.wait_for(way(server, frame, headers), 30)
        except (OSError, TimeoutError, ConnectionError):
            pass


async def opened(server):
    return await asyncio.open_connection(server.host, server.port)


async def slow_head(server, _frame, _headers):
    _, writer = await opened(server)
    for byte in b"GET / HTTP/1.1\r\nHost: localhost\r\nX-Slow: ":
        writer.write(bytes([byte]))
        await writer.drain()
        await asyncio.sleep(1)


async def silent(server, _frame, _headers):
    streams = [await opened(server) for _ in range(40)]
    await asyncio.sleep(10)
    for _, writer in streams:
        writer.close()


async def malformed(server, _frame, _headers):
    for junk in [b"\x16\x03\x01\x02\x00", b"GET\r\n\r\n", b"GET /%ff%00 HTTP/1.1\r\nHost: localhost\r\n\r\n", os.urandom(4096)]:
        reader, writer = await opened(server)
        writer.write(junk)
        await asyncio.wait_for(reader.read(), 5)
        writer.close()


async def slow_reader(server, frame, headers):
    reader, writer = await opened(server)
    writer.write(f"GET {frame.replace('96,72', '1600,1200')} HTTP/1.1\r\nHost: localhost\r\n{headers}\r\n".encode())
    for _ in range(25):
        await asyncio.sleep(1)
        if not await reader.read(64):
            return


async def large_frame(server, frame, headers):
    await ask(server, f"GET {frame.replace('96,72', '1280,960')}&sample_distance_mm=0.2", headers, patience=20)


async def vanishing(server, frame, headers):
    for _ in range(5):
        _, writer = await opened(server)
        writer.write(f"GET {frame.replace('96,72', '1280,960')}&azimuth_deg={random.random()} HTTP/1.1\r\nHost: localhost\r\n{headers}\r\n".encode())
        await writer.drain()
        await asyncio.sleep(0.3)
        writer.transport.abort()


async def slow_upload(server, _frame, headers):
    _, writer = await opened(server)
    head = "POST /v1/volumes HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/zip\r\nContent-Length: 99999999\r\n"
    writer.write(f"{head}{headers}\r\n".encode())
    for _ in range(20):
        writer.write(b"P")
        await writer.drain()
        await asyncio.sleep(1)


async def flood(server, frame, headers):
    asked = [ask(server, f"GET {frame}&azimuth_deg={random.random()}", headers, patience=20) for _ in range(20)]
    await asyncio.gather(*asked, return_exceptions=True)


class Place:
    """Where a server listens, for another process."""

    def __init__(self, server):
        self.host, self.port = server.host, server.port


def attack(place, frame, tokens, seconds):
    """The hostile clients, in a process of their own: their work must not delay the clocks of the honest ones."""
    until = time.monotonic() + seconds

    async def all_of_them():
        await asyncio.gather(*(hostile(place, frame, bearer(token), number, until) for number, token in enumerate(tokens)))

    asyncio.run(all_of_them())


def bearer(token):
    return f"Authorization: Bearer {token}\r\n"


def new_token(program, path, name, scope):
    made = subprocess.run([program, "token", "add", path, "--name", name, "--scope", scope], stdout=subprocess.PIPE, check=True, text=True)
    return made.stdout.strip()


def phase(server, frame, polite, rude, seconds):
    """The answers of honest clients in some seconds, with hostile ones beside them."""
    counts = {"times": [], "put_off": 0, "wrong": []}
    attackers = multiprocessing.Process(target=attack, args=(Place(server), frame, rude, seconds))
    attackers.start()
    until = time.monotonic() + seconds
    memory = []

    async def watch():
        while time.monotonic() < until:
            memory.append((time.monotonic(), server.rss()))
            await asyncio.sleep(1)

    async def all_of_them():
        await asyncio.gather(watch(), *(honest(server, frame, bearer(token), until, counts) for token in polite))

    asyncio.run(all_of_them())
    attackers.join(60)
    attackers.kill()
    late = [rss for at, rss in memory if at > until - 0.8 * seconds]
    counts["grown"] = max(late[len(late) // 2 :]) / max(late[: len(late) // 2])
    return counts


def many_clients(options, series, folder):
    """Honest clients alone, and then with five in a hundred hostile ones. Each client has a token of its own."""
    file = folder / "tokens"
    polite = [new_token(options.program, file, f"display-{number}", "view") for number in range(options.clients)]
    rude = [new_token(options.program, file, f"attacker-{number}", "admin") for number in range(options.clients // 20)]
    server = Server(options.program, "--series", series, "--token-file", file, "--uploads", "on")
    try:
        wait_ready(server)
        frame = f"/v1/volumes/{first_volume(server, bearer(polite[0]))}/frame?layout=color&size_px=96,72"
        for _ in range(20):  # shaders are compiled, caches are warm
            asyncio.run(ask(server, f"GET {frame}&azimuth_deg={random.random()}", bearer(polite[0])))
        alone = phase(server, frame, polite[len(rude) :], [], options.seconds)
        attacked = phase(server, frame, polite[len(rude) :], rude, options.seconds)
        before, after = (quantile(counts["times"], 0.99) for counts in (alone, attacked))
        name = f"{options.clients} clients, {options.seconds} s"
        ratio = after / before
        row(name, "99th percentile of honest clients, attacked to alone", f"{ratio:.2f} ({after * 1e3:.0f} to {before * 1e3:.0f} ms)", "1.5", ratio <= 1.5)
        medians = [statistics.median(counts["times"]) * 1e3 for counts in (attacked, alone)]
        row(name, "median of honest clients, attacked and alone", f"{medians[0]:.1f} and {medians[1]:.1f} ms", "-", True)
        wrong = alone["wrong"] + attacked["wrong"]
        frames = len(alone["times"]) + len(attacked["times"])
        row(name, "answers that are no whole frame, 429 or 503", f"{len(wrong)} of {frames} {wrong[:3] or ''}", "0", not wrong)
        row(name, "put off by 429 or 503", str(attacked["put_off"]), "-", True)
        row(name, "memory, second half to first of the last four fifths", f"{attacked['grown']:.3f}", "1.05", attacked["grown"] <= 1.05)
    finally:
        server.kill()


# ---------------------------------------------------------------- faults


def kills(options, series, folder):
    """SIGKILL under load, again and again: the server is back, and acknowledged edits are there."""
    log = folder / "kills.db"
    acknowledged, slowest = [], 0.0

    async def load(server, path, until):
        number = len(acknowledged)
        while time.monotonic() < until:
            name = f"p{number}"
            item = {"name": name, "geometry": {"kind": "point", "at_mm": [0, 0, number]}}
            body = json.dumps({"changes": [{"change": "create", "item": item}]}).encode()
            status, _, _ = await ask(server, f"POST {path}", "Content-Type: application/json\r\nRelief-Author: anna\r\n", body, 10)
            if status == 201:
                acknowledged.append(name)
            number += 1

    port = 0
    for _ in range(options.kills):
        server = Server(options.program, "--series", series, "--annotations", log, port=port)
        port = server.port
        wait_ready(server, "/healthz")
        slowest = max(slowest, time.monotonic() - server.since)
        wait_ready(server)
        path = f"/v1/volumes/{first_volume(server)}/annotations"
        loading = asyncio.new_event_loop()
        task = loading.create_task(load(server, path, time.monotonic() + 5))
        loading.call_later(random.uniform(0.02, 0.3), server.kill)
        try:
            loading.run_until_complete(task)
        except (OSError, TimeoutError, ConnectionError):
            pass
        loading.close()
        server.process.wait()
    with sqlite3.connect(log) as database:
        texts = database.execute("SELECT item FROM events WHERE item IS NOT NULL").fetchall()
    kept = {json.loads(text[0])["name"] for text in texts}
    lost = [name for name in acknowledged if name not in kept]
    name = f"{options.kills} SIGKILLs"
    row(name, "acknowledged events lost", f"{len(lost)} of {len(acknowledged)}", "0", not lost and bool(acknowledged))
    row(name, "longest from start to an answer", f"{slowest:.2f} s", "2 s", slowest <= 2)


def terminations(options, series, folder):
    """SIGTERM at any moment, with pictures under way, and with a log that does not answer."""
    slowest = 0.0
    log = folder / "terminations.db"
    for number in range(options.terminations):
        server = Server(options.program, "--series", series, "--annotations", log)
        hanging = None
        if number % 2:
            wait_ready(server)
            path = f"/v1/volumes/{first_volume(server)}"
            hanging = sqlite3.connect(log, isolation_level=None)
            hanging.execute("BEGIN EXCLUSIVE")
            body = json.dumps({"changes": [{"change": "create", "item": {"name": "a", "geometry": {"kind": "point", "at_mm": [0, 0, 0]}}}]})

            async def load():
                edit = ask(server, f"POST {path}/annotations", "Content-Type: application/json\r\nRelief-Author: anna\r\n", body.encode(), 20)
                picture = ask(server, f"GET {path}/frame?layout=color&size_px=1600,1200&sample_distance_mm=0.05", patience=20)
                tasks = [asyncio.ensure_future(edit), asyncio.ensure_future(picture)]
                await asyncio.sleep(random.uniform(0.05, 1))
                took = await asyncio.to_thread(server.terminate)
                for task in tasks:
                    task.cancel()
                await asyncio.gather(*tasks, return_exceptions=True)
                return took

            slowest = max(slowest, asyncio.run(load()))
            hanging.close()
        else:
            time.sleep(random.uniform(0, 1.5))
            slowest = max(slowest, server.terminate())
    name = f"{options.terminations} SIGTERMs, half with a log that does not answer"
    row(name, "longest to the exit", f"{slowest:.2f} s", "10 s", slowest <= 10)


def lost_devices(options, series):
    """The graphics device is lost every few pictures: the same bytes come out, and soon."""
    whole = Server(options.program, "--series", series)
    broken = Server(options.program, "--series", series, "--fault", "device-lost=3")
    try:
        for server in (whole, broken):
            wait_ready(server)
        frame = f"/v1/volumes/{first_volume(whole)}/frame?layout=color&size_px=96,72"
        wrong, slowest, pictures = 0, 0.0, 3 * options.losses

        async def compare():
            nonlocal wrong, slowest
            for number in range(pictures):
                line = f"GET {frame}&azimuth_deg={number * 0.7}"
                since = time.monotonic()
                (status, _, body), (_, _, expected) = await asyncio.gather(ask(broken, line), ask(whole, line))
                slowest = max(slowest, time.monotonic() - since)
                wrong += status != 200 or body != expected

        asyncio.run(compare())
        name = f"device lost {options.losses} times"
        row(name, "pictures that differ from those of a whole device", f"{wrong} of {pictures}", "0", wrong == 0)
        row(name, "longest picture", f"{slowest:.2f} s", "3 s", slowest <= 3)
        row(name, "restarts of the server", "0" if broken.process.poll() is None else "1", "0", broken.process.poll() is None)
    finally:
        whole.kill()
        broken.kill()


def isolation(options, series, folder):
    """Reading an upload in a child without rights, and in the server: how long each takes."""
    archive = folder / "series.zip"
    slices = sorted(Path(series).rglob("*.dcm"))
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_STORED) as made:
        for number, path in enumerate(slices):
            made.write(path, f"{number}.dcm")
    body = archive.read_bytes()
    servers = {state: Server(options.program, "--isolation", state, "--uploads", "on") for state in ("on", "off")}
    times = {"on": [], "off": []}
    try:
        for server in servers.values():
            wait_ready(server)
        for _ in range(options.readings):
            for state, server in servers.items():
                since = time.monotonic()
                status, _, answer = asyncio.run(ask(server, "POST /v1/volumes", "Content-Type: application/zip\r\n", body, 300))
                times[state].append(time.monotonic() - since)
                assert status == 201, answer[:300]
                asyncio.run(ask(server, f"DELETE /v1/volumes/{json.loads(answer)['id']}"))
    finally:
        for server in servers.values():
            server.kill()
    child, own = (statistics.median(times[state]) for state in ("on", "off"))
    ratio = child / own
    row(f"{len(slices)} slices uploaded, {len(body) >> 20} MiB", "in a child to in the server", f"{ratio:.3f} ({child:.2f} to {own:.2f} s)", "1.10", ratio <= 1.1)


def description(options, series, folder):
    """Generated requests against the API description, with sign-in off and on."""
    if not options.schemathesis:
        print("torture: UNAVAILABLE: Schemathesis; generated requests are left out", file=sys.stderr)
        return
    tokens = folder / "generated-tokens"
    made = [options.program, "token", "add", tokens, "--name", "generated", "--scope", "admin"]
    token = subprocess.run(made, check=True, capture_output=True, text=True).stdout.split()[-1]
    for name, arguments in {"off": [], "on": ["--token-file", tokens]}.items():
        log = folder / f"generated-{name}.db"
        server = Server(options.program, "--series", series, "--annotations", log, "--uploads", "on", *arguments)
        try:
            wait_ready(server)
            work = folder / f"generated-{name}"
            work.mkdir()
            statuses, findings = generate(options.schemathesis, server, work, options.examples, token if arguments else None)
            scenario = f"{sum(statuses.values())} generated requests, sign-in {name}"
            for finding in findings:
                print(f"torture: {scenario}: {finding}", file=sys.stderr)
            failed = sum(count for status, count in statuses.items() if status == "none" or (status >= 500 and status != 503))
            row(scenario, "answers of 5xx but 503, or none", failed, "0", failed == 0)
            row(scenario, "answers that do not follow the API description", len(findings), "0", not findings)
            row(scenario, "restarts of the server", int(server.process.poll() is not None), "0", server.process.poll() is None)
        finally:
            server.kill()


def malformed_files(options, folder):
    """Malformed DICOM in categories, each series read by a process of its own."""
    base = folder / "whole"
    subprocess.run([options.program, "phantom", "--kind", "sphere", "--size", "16", "--out", base], check=True, stdout=subprocess.DEVNULL)
    slices = [Slice(path.read_bytes()) for path in sorted(base.rglob("*.dcm"))]
    categories, failures = render_all(options.program, slices, folder / "malformed")
    for failure in failures:
        print(f"torture: malformed DICOM: {failure}", file=sys.stderr)
    inputs = sum(category.inputs for category in categories)
    slowest, peak = max(category.seconds for category in categories), max(category.mib for category in categories)
    scenario = f"{len(categories)} categories of malformed DICOM, {inputs} series"
    row(scenario, "panics, signals, hangs over 5 s, peaks over 512 MiB", len(failures), "0", not failures)
    row(scenario, "slowest, and largest peak", f"{slowest:.2f} s, {peak:.0f} MiB", "5 s, 512 MiB", not failures)
    print("| category | series | refused | accepted | the first refusal |\n|---|---|---|---|---|")
    for category in categories:
        print(f"| {category.name} | {category.inputs} | {category.refused} | {category.accepted} | {category.refusal} |")


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--program", required=True)
    arguments.add_argument("--series", required=True, help="a small series")
    arguments.add_argument("--large", help="a series of hundreds of slices, for the reading in a child")
    arguments.add_argument("--clients", type=int, default=200)
    arguments.add_argument("--seconds", type=int, default=300)
    arguments.add_argument("--kills", type=int, default=1000)
    arguments.add_argument("--terminations", type=int, default=40)
    arguments.add_argument("--losses", type=int, default=100)
    arguments.add_argument("--readings", type=int, default=5)
    arguments.add_argument("--schemathesis", help="the program that generates requests")
    arguments.add_argument("--examples", type=int, default=40, help="generated requests for each path and method, at most")
    arguments.add_argument("--only", default="clients,kills,terminations,devices,isolation,description,malformed")
    options = arguments.parse_args()
    random.seed(1)
    wanted = options.only.split(",")
    with tempfile.TemporaryDirectory() as folder:
        folder = Path(folder)
        if "clients" in wanted:
            many_clients(options, options.series, folder)
        if "kills" in wanted:
            kills(options, options.series, folder)
        if "terminations" in wanted:
            terminations(options, options.series, folder)
        if "devices" in wanted:
            lost_devices(options, options.series)
        if "isolation" in wanted:
            isolation(options, options.large or options.series, folder)
        if "description" in wanted:
            description(options, options.series, folder)
        if "malformed" in wanted:
            malformed_files(options, folder)
    print("| scenario | measured | figure | bar | |\n|---|---|---|---|---|")
    for scenario, what, figure, bar, holds in ROWS:
        print(f"| {scenario} | {what} | {figure} | {bar} | {'holds' if holds else '**missed**'} |")
    sys.exit(0 if all(holds for *_, holds in ROWS) else 1)


if __name__ == "__main__":
    main()
