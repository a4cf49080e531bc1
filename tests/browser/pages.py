"""Parts that the tests of the pages share: a server, a window of Chromium, and the page for annotations in one.

With RELIEF_PAGE_URL a server that runs is used, with RELIEF_PAGE_FILES=FOLDER the pages' files come from there and not from the
program, and with RELIEF_PAGE_SHOTS=FOLDER pictures are kept there.
"""

import json
import os
import pathlib
import re
import signal
import socket
import subprocess
import time
import urllib.parse
import urllib.request

import axe_playwright_python

SHOTS = os.environ.get("RELIEF_PAGE_SHOTS")
FILES = os.environ.get("RELIEF_PAGE_FILES") and pathlib.Path(os.environ["RELIEF_PAGE_FILES"])
SIZE = {"width": 1280, "height": 720}
TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}


def page_files():
    """Addresses of the pages' files and their names in the folder, as the server has them."""
    listed = FILES.with_suffix(".rs").read_text(encoding="utf-8")
    return re.findall(r'\("(/[^"]*)", [^,]+, include_str!\("page/([^"]+)"\)\)', listed)


def from_disk(path):
    return lambda route: route.fulfill(body=path.read_bytes(), content_type=TYPES[path.suffix] + "; charset=utf-8")


#: axe-core, the accessibility checks of Deque, as its Python package has them.
AXE = (pathlib.Path(axe_playwright_python.__file__).parent / "axe.min.js").read_text(encoding="utf-8")
#: The violations of a page: rule, impact and elements.
VIOLATIONS = """
axe.run(document, { resultTypes: ['violations'] }).then(({ violations, passes }) => ({
  passes: passes.length,
  violations: violations.map(({ id, impact, nodes }) => [id, impact, nodes.map(({ html, failureSummary }) => [html.slice(0, 160), failureSummary])]),
}))
"""


def accessibility(page):
    """The findings of axe-core in a page as it is shown."""
    page.page.evaluate(AXE)
    return page.page.evaluate(VIOLATIONS)


def settled(page):
    """The picture of the page of the volume is whole."""
    page.wait("document.getElementById('timing').innerText.includes('in all') && !document.getElementById('busy').classList.contains('on')", 60)
    page.page.wait_for_timeout(400)
    page.wait("!document.getElementById('busy').classList.contains('on')", 60)


def launched(playwright, chromium):
    # Files that come from elsewhere than the server make it another network's for Chromium, which then wants to be asked.
    more = ["--disable-features=LocalNetworkAccessChecks"] if FILES else []
    return playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu", *more])


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


class Server:
    """relief serve with or without a series and annotations. With RELIEF_PAGE_URL one that runs already."""

    def __init__(self, relief, series, *more):
        self.process = None
        self.url = os.environ.get("RELIEF_PAGE_URL")
        if not self.url:
            port = free_port()
            self.url = f"http://127.0.0.1:{port}"
            shown = ["--series", series] if series else []
            command = [relief, "serve", *shown, "--listen", f"127.0.0.1:{port}", *more]
            self.command = command
            self.start()
        # Without a series it is never ready, but answers.
        self.wait("/readyz" if series else "/healthz")
        self.volumes = self.get("/v1/volumes")["volumes"]
        self.volume = f"/v1/volumes/{self.volumes[0]['id']}" if series else None

    def wait(self, path="/readyz"):
        for _ in range(600):
            try:
                if urllib.request.urlopen(self.url + path).status == 200:
                    return
            except OSError:
                time.sleep(0.1)
        raise SystemExit("the server is not ready after a minute")

    def start(self):
        environment = {**os.environ, "RELIEF_ADAPTER": "cpu", "RELIEF_LOG": "warn"}
        self.process = subprocess.Popen(self.command, env=environment, stdout=subprocess.DEVNULL)

    def get(self, path, author="test"):
        asked = urllib.request.Request(self.url + path, headers={"Relief-Author": author})
        return json.loads(urllib.request.urlopen(asked).read())

    def annotations(self, author="test"):
        return self.get(f"{self.volume}/annotations", author)

    def add_points(self, author="test", **points):
        """Adds points by their names, patient LPS mm."""
        place = lambda at: {"kind": "point", "at_mm": at}
        items = [{"set": author, "name": name, "geometry": place(at)} for name, at in points.items()]
        changes = [{"change": "create", "item": item} for item in items]
        edit = json.dumps({"reason": "a test", "changes": changes}).encode()
        headers = {"Relief-Author": author, "Content-Type": "application/json"}
        urllib.request.urlopen(urllib.request.Request(f"{self.url}{self.volume}/annotations", data=edit, headers=headers)).read()

    def item(self, name):
        """The entry of this name, waited for."""
        for _ in range(600):
            for entry in self.annotations()["items"]:
                if entry["item"]["name"] == name:
                    return entry
            time.sleep(0.05)
        raise SystemExit(f"no item {name!r}")

    def kill(self):
        if self.process:
            self.process.send_signal(signal.SIGKILL)
            self.process.wait()


def is_answer(message):
    """Whether the browser itself tells of an answer that tests ask for: a conflict (409), a file that is refused or a leak (422)."""
    path = urllib.parse.urlsplit(message.location.get("url", "")).path
    refused = path.endswith(("/annotations/import", "/annotations/grow")) or path == "/v1/volumes"
    return "status of 409" in message.text or (refused and "status of 422" in message.text)


class Window:
    """One window with one of the pages."""

    def __init__(self, browser, server, path, size=SIZE, author=None, **more):
        self.server = server
        self.asked = {}
        self.problems = []
        self.context = browser.new_context(viewport=size, accept_downloads=True, **more)
        self.page = self.context.new_page()
        if FILES:
            for address, name in page_files():
                self.page.route(re.compile(re.escape(server.url + address) + r"(\?.*)?$"), from_disk(FILES / name))
        self.page.on("pageerror", lambda error: self.problems.append(error.message))
        said = lambda message: message.type == "error" and not is_answer(message)
        self.page.on("console", lambda message: said(message) and self.problems.append(message.text))
        self.page.on("request", self.__note)
        if author:
            self.page.add_init_script(f"localStorage.setItem('relief-author', {json.dumps(author)})")
        self.page.goto(server.url + path)

    def __note(self, request):
        address = urllib.parse.urlsplit(request.url)
        query = dict(urllib.parse.parse_qsl(address.query))
        if address.path.endswith("/slice"):
            self.asked[query.get("plane", "oblique")] = query
        elif address.path.endswith("/frame"):
            self.asked["volume"] = query

    def wait(self, condition, seconds=30):
        """Asks until an expression is true. Playwright's own way would evaluate text, which the page's policy forbids."""
        for _ in range(20 * seconds):
            if self.page.evaluate(condition):
                return
            self.page.wait_for_timeout(50)
        self.shot("stuck")
        panes = "[...document.querySelectorAll('.pane')].map((pane) => `${pane.className} ${JSON.stringify(pane.dataset)} ${pane.querySelector('.busy.on') ? 'busy' : ''}`)"
        raise SystemExit(f"not within {seconds} s: {condition}; {self.page.evaluate(panes)}; {self.page.inner_text('body')[:800]}")

    def key(self, key):
        self.page.keyboard.press(key)

    def shot(self, name):
        if SHOTS:
            self.page.screenshot(path=f"{SHOTS}/{name}.png")


class Page(Window):
    """One window of the page for annotations, as one author."""

    def __init__(self, browser, server, author, size=SIZE, **more):
        super().__init__(browser, server, "/annotate", size, author, **more)
        self.still()

    def still(self):
        self.wait("document.querySelectorAll('.pane[data-still=true]').length === 5 && !document.querySelector('.pane .busy.on')", 60)
        self.page.wait_for_timeout(250)
        self.wait("document.querySelectorAll('.pane[data-still=true]').length === 5 && !document.querySelector('.pane .busy.on')", 60)

    def box(self, pane):
        return self.page.locator(f".pane-{pane}").bounding_box()

    def at(self, pane, x, y):
        """Window coordinates of a place of a pane, whole pixels."""
        box = self.box(pane)
        return round(box["x"] + x * box["width"]), round(box["y"] + y * box["height"])

    def click(self, pane, x, y):
        self.page.mouse.click(*self.at(pane, x, y))

    def asked_pick(self, pane, x, y):
        """The server's pick at the pixel that a click there meets."""
        box, (left, top) = self.box(pane), self.at(pane, x, y)
        query = {key: value for key, value in self.asked[pane].items() if key not in ("layout", "profile", "budget_ms")}
        if pane != "volume":
            query["mode"] = "slice"
        size = [int(side) for side in query["size_px"].split(",")]
        if pane != "volume":
            # A pick is of the middle of a pixel, a place of a slice exact: smaller pixels bring them together.
            size = [8 * side for side in size]
            query["size_px"] = f"{size[0]},{size[1]}"
        query["u"] = (left + 0.5 - box["x"]) * size[0] / box["width"]
        query["v"] = (top + 0.5 - box["y"]) * size[1] / box["height"]
        return self.server.get(f"{self.server.volume}/pick?{urllib.parse.urlencode(query)}")

    def pick(self, pane, x, y):
        return self.asked_pick(pane, x, y)["patient_mm"]

    def value(self, pane, x, y):
        return self.asked_pick(pane, x, y)["hu"]

    def rows(self):
        return self.page.evaluate("[...document.querySelectorAll('.item')].map((row) => row.getAttribute('aria-label'))")

    def wait_row(self, text):
        self.wait(f"[...document.querySelectorAll('.item')].some((row) => row.getAttribute('aria-label').includes({json.dumps(text)}))")
