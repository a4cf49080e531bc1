"""Drives the kiosk and monitor pages in Chromium, and prints its findings as one JSON object.

usage: kiosk.py RELIEF CHROMIUM SERIES REPORTS

RELIEF serves SERIES; REPORTS is a recording of a Wiimote. Playwright forces a colour profile of its own upon Chromium: that
flag is left out, since the pages have to be exact without it.
"""

import io
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import urllib.request
import zipfile

import numpy
import rest
import space
from PIL import Image
from playwright.sync_api import sync_playwright

RELIEF, CHROMIUM, SERIES, REPORTS = sys.argv[1:5]
FRAME = {"width": 1920, "height": 1080}
ROOT = "document.documentElement.dataset"


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


class Server:
    """relief serve, on a port that stays the same when it is started again."""

    def __init__(self):
        self.port = free_port()
        self.url = f"http://127.0.0.1:{self.port}"
        self.start()

    def start(self):
        command = [RELIEF, "serve", "--series", SERIES, "--listen", f"127.0.0.1:{self.port}"]
        environment = {**os.environ, "RELIEF_ADAPTER": "cpu", "RELIEF_LOG": "warn"}
        self.process = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL)
        for _ in range(600):
            try:
                if urllib.request.urlopen(f"{self.url}/readyz").status == 200:
                    return
            except OSError:
                time.sleep(0.1)
        raise SystemExit("the server is not ready after a minute")

    def kill(self):
        self.process.send_signal(signal.SIGKILL)
        self.process.wait()

    def get(self, path):
        return urllib.request.urlopen(self.url + path).read()


def pixels(png):
    return numpy.array(Image.open(io.BytesIO(png)).convert("RGB")).astype(int)


def browser(playwright, *more):
    arguments = ["--no-sandbox", "--disable-gpu", *more]
    left_out = ["--force-color-profile=srgb"]
    return playwright.chromium.launch(executable_path=CHROMIUM, args=arguments, ignore_default_args=left_out)


def page_of(opened, url, script=None):
    page = opened.new_page(viewport=FRAME, screen=FRAME)
    problems = []
    page.on("pageerror", lambda error: problems.append(error.message))
    page.on("console", lambda said: said.type == "error" and problems.append(said.text))
    if script:
        page.add_init_script(script)
    page.goto(url)
    return page, problems


def wait_for(page, condition, seconds=30):
    """Asks until an expression is true. Playwright's own way would evaluate text in the page, which its policy forbids."""
    for _ in range(20 * seconds):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(50)
    raise SystemExit(f"not within {seconds} s: {condition}; {page.evaluate('JSON.stringify(' + ROOT + ')')}")


def waiting(page, text, seconds=30):
    """State and words of a page that waits and says this. Between two tries it says that it connects."""
    for _ in range(20 * seconds):
        connection, said = page.evaluate(f"[{ROOT}.connection, document.getElementById('state').innerText]")
        if connection == "waiting" and text in said:
            return {"connection": connection, "said": said}
        page.wait_for_timeout(50)
    raise SystemExit(f"not within {seconds} s: {text}; {connection}: {said}")


def wait_still(page, after=0):
    """Waits for a still frame that shows a message beyond `after`."""
    wait_for(page, f"{ROOT}.still === 'true' && Number({ROOT}.shows) >= {after}", 60)


def view(page):
    return page.evaluate("window.kioskView")


def exactness(playwright, server):
    """The screen, against the frame that is served for the same view; with and without another profile."""
    volume = json.loads(server.get("/v1/volumes"))["volumes"][0]["id"]
    query = "azimuth_deg=20&elevation_deg=10&zoom=1&frame=tissue&preset=bone&layout=wowvx&overlay=caption"
    served = pixels(server.get(f"/v1/volumes/{volume}/frame?{query}"))
    found = {}
    for name, arguments in {"srgb": [], "p3": ["--force-color-profile=display-p3-d65"]}.items():
        opened = browser(playwright, *arguments)
        page, problems = page_of(opened, f"{server.url}/kiosk?preset=bone")
        wait_still(page)
        shot = pixels(page.screenshot())
        different = int((shot != served).any(axis=2).sum()) if shot.shape == served.shape else -1
        found[name] = {"different": different, "test": page.evaluate(f"{ROOT}.test"), "problems": problems}
        page.keyboard.press("m")
        page.wait_for_selector("#menu[open]")
        found[name]["menu"] = page.inner_text("#menu")
        monitor, problems = page_of(opened, f"{server.url}/monitor")
        found[name]["monitor"] = {"test": monitor.evaluate(f"{ROOT}.test"), "problems": problems}
        opened.close()
    return found


def arranged(name, left, right, quilt):
    """The pixels of an output, from views that the server made: both eyes, or nine views of a quilt."""
    height, width = left.shape[:2]
    rows, columns = numpy.indices((height, width))
    mean = lambda a, b: (a + b + 1) // 2
    choose = lambda second: numpy.where(second[:, :, None], right, left)
    if name == "lenses":
        views = [quilt[(2 - v // 3) * height :][:height, v % 3 * width :][:, :width] for v in range(9)]
        out = numpy.empty_like(left)
        for third in range(3):
            along = numpy.float32((columns + (third + 0.5) / 3 + rows * 0.25) / 4.5 - 0.125)
            number = numpy.minimum(((along - numpy.floor(along)) * 9).astype(int), 8)
            out[:, :, third] = numpy.choose(number, [view[:, :, third] for view in views])
        return out
    return {
        "stereo": lambda: numpy.concatenate([left, right], 1),
        "stereo&swap": lambda: numpy.concatenate([right, left], 1),
        "stereo-half": lambda: numpy.concatenate([mean(eye[:, ::2], eye[:, 1::2]) for eye in (left, right)], 1),
        "top-bottom": lambda: numpy.concatenate([left, right], 0),
        "top-bottom-half": lambda: numpy.concatenate([mean(eye[::2], eye[1::2]) for eye in (left, right)], 0),
        "lines": lambda: choose(rows % 2 == 1),
        "columns": lambda: choose(columns % 2 == 1),
        "checkerboard": lambda: choose((rows + columns) % 2 == 1),
        "quilt": lambda: quilt,
    }[name]()


def outputs(playwright, server):
    """Views that the page makes, against those that the server makes of the same picture."""
    opened = browser(playwright, "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
    volume = json.loads(server.get("/v1/volumes"))["volumes"][0]["id"]
    query = "azimuth_deg=20&elevation_deg=10&zoom=1&frame=tissue&preset=bone&size_px=480,270"
    served = lambda layout, more="": pixels(server.get(f"/v1/volumes/{volume}/frame?{query}&layout={layout}{more}"))
    # The kiosk makes views of one layer by default, the server of two.
    frame = tempfile.NamedTemporaryFile(suffix=".png")
    frame.write(server.get(f"/v1/volumes/{volume}/frame?{query}&layout=rgbd"))
    frame.flush()

    def one_layer(layout):
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([RELIEF, "preview", frame.name, "--layout", layout, "--out", f"{folder}/views.png"], check=True, capture_output=True)
            return pixels(open(f"{folder}/views.png", "rb").read())

    pair, quilt = one_layer("stereo"), one_layer("views-9")
    left, right = pair[:, :480], pair[:, 480:]
    two_layers = served("stereo")
    found = {"eyes_differ": int((left != right).any(axis=2).sum())}
    names = ["stereo", "stereo&swap", "stereo-half", "top-bottom", "top-bottom-half", "lines", "columns", "checkerboard", "quilt", "lenses"]
    for name in names:
        more = "&lens=4.5,0.25,0.125" if name == "lenses" else ""
        expected = arranged(name, left, right, quilt)
        page, problems = page_of(opened, f"{server.url}/kiosk?caption=false&preset=bone&size=480x270&rest=synthesised&output={name}{more}")
        wait_still(page)
        shot = pixels(page.locator("#frame").screenshot())
        different = int((shot != expected).any(axis=2).sum()) if shot.shape == expected.shape else -1
        found[name] = {"different": different, "problems": problems}
        if name in ("stereo-half", "top-bottom", "top-bottom-half", "lines", "columns", "checkerboard"):
            expected = arranged(name, two_layers[:, :480], two_layers[:, 480:], quilt)
            found[name]["served"] = int((served(name) != expected).any(axis=2).sum())
        page.close()
    # The layout with a back layer has the size of the display.
    two = pixels(server.get(f"/v1/volumes/{volume}/frame?{query.replace('480,270', '960,540')}&layout=stereo"))
    page, problems = page_of(opened, f"{server.url}/kiosk?caption=false&preset=bone&output=stereo&rest=synthesised&layers=2")
    wait_still(page)
    shot = pixels(page.locator("#frame").screenshot())
    found["layers"] = {"different": int((shot != two).any(axis=2).sum()) if shot.shape == two.shape else -1, "problems": problems}
    before = int(page.evaluate(f"{ROOT}.frame"))
    page.keyboard.press("ArrowRight")
    wait_for(page, f"Number({ROOT}.frame) > {before} && {ROOT}.still === 'true'")
    page.keyboard.press("m")
    page.wait_for_selector("#menu[open]")
    found["facts"] = page.inner_text("#facts")
    page.close()
    # Test pictures: the same for both eyes in the plane of the screen, and exchanged eyes in depth.
    page, problems = page_of(opened, f"{server.url}/monitor")
    page.select_option("#layout", "stereo")
    page.select_option("#picture", "screen")
    halves = lambda: numpy.split(pixels(page.locator("#frame").screenshot()), 2, 1)
    page.click("#hide")
    flat = halves()
    page.keyboard.press("Escape")
    page.select_option("#picture", "steps")
    page.click("#hide")
    deep = halves()
    page.keyboard.press("Escape")
    page.check("#swap")
    page.click("#hide")
    swapped = halves()
    page.keyboard.press("Escape")
    same = lambda a, b: bool((a == b).all())
    found["monitor"] = {
        "flat": same(*flat), "deep": not same(*deep), "swapped": same(deep[0], swapped[1]) and same(deep[1], swapped[0]),
        "address": page.inner_text("#words"), "problems": problems,
    }
    page.select_option("#layout", "lenses")
    found["monitor"]["lenses"] = page.is_visible("#pitch") and "lens=5" in page.inner_text("#words")
    page.close()
    page, _ = page_of(opened, f"{server.url}/kiosk?output=hologram")
    found["refused"] = page.inner_text("#state")
    opened.close()
    return found


def comfort(playwright, server):
    """Parallax that the menu states, and warnings, against the disparity of the served frame."""
    opened = browser(playwright)
    volume = json.loads(server.get("/v1/volumes"))["volumes"][0]["id"]
    query = "azimuth_deg=20&elevation_deg=10&zoom=1&frame=tissue&preset=bone&layout=wowvx"
    found = {}
    for name, more, factor in [("usual", "", 64), ("strong", "&factor=192", 192), ("strict", "&comfort=0.1,0.1", 64)]:
        served = pixels(server.get(f"/v1/volumes/{volume}/frame?{query}&factor={factor}"))
        disparity = numpy.sort(served[::2, 960:, 0][1:].ravel())
        disparity = disparity[disparity > 0]
        page, problems = page_of(opened, f"{server.url}/kiosk?caption=false&preset=bone{more}")
        wait_still(page)
        page.keyboard.press("m")
        page.wait_for_selector("#menu[open]")
        page.wait_for_timeout(1200)
        ends = [int(disparity[int(len(disparity) * share)]) for share in (0.01, 0.99)]
        found[name] = {
            "words": page.inner_text("#facts"), "comfort": page.evaluate(f"{ROOT}.comfort"), "ends": ends, "factor": factor,
            "warnings": page.inner_text("#comfort"), "problems": problems,
        }
        page.close()
    page, _ = page_of(opened, f"{server.url}/kiosk?comfort=0,3")
    found["refused"] = page.inner_text("#state")
    opened.close()
    return found


def eyes(playwright, server):
    """Views that follow the eyes of a head tracker, against pages whose address has the same places of the eyes."""
    opened = browser(playwright, "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
    tracker = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        geometry = os.path.join(folder, "display.json")
        with open(geometry, "w", encoding="ascii") as file:
            json.dump({"rest_mm": [0, 0, 600], "eye_separation_mm": 60}, file)
        command = [RELIEF, "client", "--server", server.url, "--headless", "--role", "watcher", "--view", "eyes"]
        command += ["--eyes", f"opentrack:127.0.0.1:{port}", "--display-geometry", geometry]
        address = f"{server.url}/kiosk?caption=false&preset=bone&size=480x270&view=eyes&distance=600&rest=synthesised"
        pages = {name: page_of(opened, f"{address}&output={name}") for name in ("flat", "stereo")}
        for page, _ in pages.values():
            wait_still(page)
        client = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        found["connected"] = any("connected" in line for line in iter(client.stderr.readline, ""))

        def send(*numbers):
            tracker.sendto(struct.pack("<6d", *numbers), ("127.0.0.1", port))

        def shown(name, numbers):
            page, problems = pages[name]
            before = int(page.evaluate(f"{ROOT}.eyes ?? 0"))
            for _ in range(3):
                send(*numbers)
                page.wait_for_timeout(150)
            wait_for(page, f"Number({ROOT}.eyes ?? 0) > {before}")
            page.wait_for_timeout(300)
            return pixels(page.locator("#frame").screenshot()), problems

        def fixed(name, more):
            page, problems = page_of(opened, f"{address}&output={name}{more}".replace("view=eyes", "view=fixed"))
            wait_still(page)
            shot = pixels(page.locator("#frame").screenshot())
            page.close()
            return shot

        rest = pixels(pages["flat"][0].locator("#frame").screenshot())
        # 130 mm to the right at 600 mm; the same at twice the distance; both eyes of a head that has turned its side.
        places = {
            "right": ("flat", (13, 0, 0, 0, 0, 0), "&eye=2"),
            "far": ("flat", (13, 0, 60, 0, 0, 0), "&eye=1"),
            "pair": ("stereo", (6.5, 0, 0, 0, 0, 0), f"&eye=1&span={60 / 65}"),
        }
        send(1, 2, 3, 4, 5, float("nan"))
        for place, (name, numbers, more) in places.items():
            shot, problems = shown(name, numbers)
            expected = fixed(name, more)
            found[place] = {"different": int((shot != expected).any(axis=2).sum()), "problems": problems}
            if name == "flat":
                found[place]["moved"] = int((shot != rest).any(axis=2).sum())
        page, _ = pages["flat"]
        page.keyboard.press("m")
        page.wait_for_selector("#menu[open]")
        page.wait_for_timeout(1200)
        found["words"] = page.inner_text("#facts")
        client.send_signal(signal.SIGINT)
        found["said"] = client.communicate()[1]
    opened.close()
    return found


def seen_by(part, playwright, server):
    opened = browser(playwright, "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
    found = part.seen(opened, server, page_of, wait_for, wait_still, pixels)
    opened.close()
    return found


def hands(playwright, server):
    """Mouse, keyboard, a click for the cursor, and the server killed and started again."""
    opened = browser(playwright)
    page, problems = page_of(opened, f"{server.url}/kiosk?caption=false&preset=bone")
    wait_still(page)
    found = {"home": view(page)}
    page.mouse.move(500, 500)
    page.mouse.down()
    for step in range(8):
        page.mouse.move(500 + 10 * step, 500 + 2 * step)
        page.wait_for_timeout(30)
    page.mouse.up()
    wait_still(page, 2)
    found["turned"] = view(page)
    page.mouse.wheel(0, -400)
    wait_for(page, f"window.kioskView.zoom > {found['turned']['zoom'] * 1.2}")
    found["zoomed"] = view(page)
    page.keyboard.press("Control+z")
    wait_for(page, f"window.kioskView.revision > {found['zoomed']['revision']}")
    page.keyboard.press("Home")
    wait_for(page, f"window.kioskView.zoom === {found['home']['zoom']}")
    page.keyboard.press("]")
    wait_for(page, "window.kioskView.preset !== 'bone'")
    page.keyboard.press("[")
    wait_for(page, "window.kioskView.preset === 'bone'")
    page.wait_for_timeout(300)
    wait_still(page)
    found["reset"] = view(page)
    # The middle of the left half, on the second line of a pair: its pixel is that of the line above.
    page.mouse.click(480, 541)
    wait_for(page, "window.kioskView.cursor_mm !== null")
    found["cursor_mm"] = view(page)["cursor_mm"]
    volume = json.loads(server.get("/v1/volumes"))["volumes"][0]["id"]
    query = "azimuth_deg=20&elevation_deg=10&zoom=1&frame=tissue&preset=bone&size_px=960,540&u=480.5&v=270.5"
    found["pick"] = json.loads(server.get(f"/v1/volumes/{volume}/pick?{query}"))
    for key in ["ArrowLeft", "Shift+ArrowUp", "+", "PageDown"]:
        page.keyboard.press(key)
    wait_for(page, "window.kioskView.clip_mm !== null")
    found["before"] = view(page)
    found["problems"] = problems[:]
    server.kill()
    found["said"] = waiting(page, "No connection")["said"]
    server.start()
    wait_for(page, f"{ROOT}.connection === 'live'", 30)
    before = int(page.evaluate(f"{ROOT}.frame"))
    wait_for(page, "window.kioskView.clip_mm !== null && window.kioskView.cursor_mm !== null")
    wait_still(page)
    found["after"] = view(page)
    found["frames"] = [before, int(page.evaluate(f"{ROOT}.frame"))]
    # From the kill on, the browser itself reports connections that were reset or refused.
    later = problems[len(found["problems"]) :]
    found["problems"] += [text for text in later if "net::ERR_CONNECTION_" not in text and "WebSocket" not in text]
    opened.close()
    return found


def zipped(folder):
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name in sorted(os.listdir(folder)):
            archive.write(os.path.join(folder, name), name)
    return file.getvalue()


def early(playwright, server):
    """A volume that is asked for before the server has it."""
    with tempfile.TemporaryDirectory() as folder:
        made = [RELIEF, "phantom", "--kind", "sphere", "--size", "32", "--out", folder + "/ball"]
        subprocess.run(made, check=True, stdout=subprocess.DEVNULL)
        ball = zipped(folder + "/ball")

    def ask(path, method, data=None):
        request = urllib.request.Request(server.url + path, data, {"Content-Type": "application/zip"}, method=method)
        return urllib.request.urlopen(request).read()

    volume = json.loads(ask("/v1/volumes", "POST", ball))["id"]
    ask(f"/v1/volumes/{volume}", "DELETE")
    opened = browser(playwright)
    page = opened.new_page(viewport=FRAME, screen=FRAME)
    problems, tries = [], []
    page.on("pageerror", lambda error: problems.append(error.message))
    page.on("websocket", lambda socket: tries.append(socket.url))
    page.goto(f"{server.url}/kiosk?caption=false&preset=bone&volume={volume}")
    wait_for(page, f"{ROOT}.connection === 'waiting'")
    page.wait_for_timeout(4000)
    found = {"tries": len(tries)}
    found |= waiting(page, "does not have this volume yet")
    ask("/v1/volumes", "POST", ball)
    wait_still(page)
    query = "azimuth_deg=20&elevation_deg=10&zoom=1&frame=tissue&preset=bone&layout=wowvx"
    served, shot = pixels(server.get(f"/v1/volumes/{volume}/frame?{query}")), pixels(page.screenshot())
    different = int((shot != served).any(axis=2).sum())
    found |= {"later": page.evaluate(f"{ROOT}.connection"), "different": different, "problems": problems}
    opened.close()
    ask(f"/v1/volumes/{volume}", "DELETE")
    return found


STUB = """
(() => {
  const reports = %s;
  const device = new EventTarget();
  const said = [];
  const report = (id, bytes) => {
    const event = new Event("inputreport");
    Object.assign(event, { reportId: id, data: new DataView(Uint8Array.from(bytes).buffer) });
    device.dispatchEvent(event);
  };
  let at = 0;
  const play = () => {
    if (at >= reports.length) return;
    const bytes = reports[at++].match(/../g).map((digits) => parseInt(digits, 16));
    report(bytes[0], bytes.slice(1));
    setTimeout(play, 10);
  };
  Object.assign(device, {
    vendorId: 0x057e, productId: 0x0306, opened: false,
    async open() { this.opened = true; },
    async sendReport(id, bytes) {
      said.push([id, ...bytes]);
      if (id === 0x12) setTimeout(play, 20);
      setTimeout(() => report(0x22, [0, 0, id, 0]), 2);
    },
  });
  window.wiimoteSaid = said;
  const hid = new EventTarget();
  Object.assign(hid, { getDevices: async () => [], requestDevice: async () => [device] });
  Object.defineProperty(navigator, "hid", { value: hid });
})();
"""


def wiimote(playwright, server):
    """A Wiimote that is not there, behind WebHID: brought up, relayed, tracked by the server."""
    with open(REPORTS, encoding="ascii") as lines:
        reports = [json.loads(line)["report"] for line in lines]
    opened = browser(playwright)
    page, problems = page_of(opened, f"{server.url}/kiosk?caption=false&preset=bone", STUB % json.dumps(reports))
    wait_still(page)
    before = view(page)
    page.keyboard.press("w")
    wait_for(page, f"{ROOT}.tracking === 'tracking'", 30)
    page.wait_for_timeout(len(reports) * 12 + 500)
    found = {"said": page.evaluate("window.wiimoteSaid"), "before": before, "after": view(page), "problems": problems}
    opened.close()
    return found


def main():
    server = Server()
    try:
        with sync_playwright() as playwright:
            found = {"exact": exactness(playwright, server)}
            found["outputs"] = outputs(playwright, server)
            found["comfort"] = comfort(playwright, server)
            found["eyes"] = eyes(playwright, server)
            found["space"] = seen_by(space, playwright, server)
            found["rest"] = seen_by(rest, playwright, server)
            found["early"] = early(playwright, server)
            found["hands"] = hands(playwright, server)
            found["wiimote"] = wiimote(playwright, server)
        print(json.dumps(found))
    finally:
        server.kill()


main()
