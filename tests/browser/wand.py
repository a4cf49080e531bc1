"""Pairs a phone with the page of a display by its QR code, and connects a SpaceMouse that a script plays; turns and points with
both, and prints what it saw as one JSON object.

usage: wand.py RELIEF CHROMIUM SERIES FOLDER
"""

import json
import os
import pathlib
import subprocess
import sys
import time

import cv2
import numpy
from pages import Server, Window, accessibility, launched
from playwright.sync_api import sync_playwright

RELIEF, CHROMIUM, SERIES, FOLDER = sys.argv[1:5]
PHONE = {"viewport": {"width": 390, "height": 780}, "has_touch": True, "is_mobile": True}


def decoded(page):
    """The text of the QR code on a page, by OpenCV; waits until it is drawn. Its other detector misses one valid code in eight."""
    for _ in range(50):
        picture = cv2.imdecode(numpy.frombuffer(page.screenshot(), numpy.uint8), cv2.IMREAD_COLOR)
        text = cv2.QRCodeDetectorAruco().detectAndDecode(picture)[0]
        if text:
            return text
        page.wait_for_timeout(200)
    raise SystemExit("no QR code is on the page")


class Phone:
    """A phone with the page of an address, and with sensors that are set."""

    def __init__(self, browser, address, script=""):
        self.context = browser.new_context(**PHONE, ignore_https_errors=True)
        self.context.add_init_script(script)
        self.context.add_init_script(
            "addEventListener('deviceorientation', (event) => { window.attitude = [event.alpha, event.beta, event.gamma]; })"
        )
        self.page = self.context.new_page()
        self.problems = []
        self.page.on("pageerror", lambda error: self.problems.append(error.message))
        self.page.goto(address)
        self.sensors = self.context.new_cdp_session(self.page)

    def until(self, condition):
        for _ in range(400):
            if self.page.evaluate(condition):
                return
            self.page.wait_for_timeout(50)
        raise SystemExit(f"not within 20 s: {condition}; {self.page.inner_text('body')}")

    def hold_up(self, alpha, beta, gamma):
        """Returns when the page has the attitude: a gesture that ended earlier would be shorter."""
        attitude = {"alpha": alpha, "beta": beta, "gamma": gamma}
        self.sensors.send("DeviceOrientation.setDeviceOrientationOverride", attitude)
        self.until(f"{list(attitude.values())}.every((angle, axis) => Math.abs(angle - window.attitude?.[axis]) < 0.1)")
        self.page.wait_for_timeout(120)

    def gesture(self, name, *attitudes):
        """Holds a button while the phone goes from attitude to attitude."""
        self.hold_up(*attitudes[0])
        box = self.page.locator(f"#{name}").bounding_box()
        self.page.mouse.move(box["x"] + 20, box["y"] + 20)
        self.page.mouse.down()
        for attitude in attitudes[1:]:
            self.hold_up(*attitude)
        self.page.mouse.up()
        self.page.wait_for_timeout(300)


def view_of(window):
    return window.page.evaluate("kioskView")


def settled(window):
    """The view when it has not changed for 750 ms, and its still picture is there."""
    views = [None]
    for _ in range(100):
        views = [*views[-3:], view_of(window)]
        if views.count(views[-1]) == 4 and window.page.evaluate("document.documentElement.dataset.still") == "true":
            return views[-1]
        window.page.wait_for_timeout(250)
    raise SystemExit("the view has not come to rest within 25 s")


def driven(browser, server):
    window = Window(browser, server, "/kiosk?caption=false&view=theatre&preset=bone&size=960x540&annotations=true")
    window.wait("document.documentElement.dataset.still === 'true'")
    window.key("p")
    window.wait("!document.getElementById('wand-pairing').hidden")
    seen = {"words": window.page.inner_text("#wand-words")}
    window.shot("wand-kiosk")
    seen["address"] = decoded(window.page)
    seen["expected"] = f"{server.url}/wand?view=theatre"
    window.key("p")
    window.page.keyboard.press("Escape")
    phone = Phone(browser, seen["address"])
    phone.until("document.documentElement.dataset.connection === 'live'")
    phone.hold_up(200, 30, 0)
    phone.until("document.documentElement.dataset.sensors === 'on'")
    if os.environ.get("RELIEF_PAGE_SHOTS"):
        phone.page.screenshot(path=os.environ["RELIEF_PAGE_SHOTS"] + "/wand.png")
    seen["violations"] = accessibility(phone)["violations"]

    seen["before"] = settled(window)
    # To the right by 25 degrees about the vertical, whatever the phone's own heading and tilt.
    phone.gesture("turn", (200, 30, 0), (190, 30, 0), (175, 30, 0))
    seen["turned"] = settled(window)
    phone.page.click("#reset")
    seen["reset"] = settled(window)
    # Up by 3 degrees: a tenth of the picture's height.
    phone.gesture("point", (10, 45, 0), (10, 47, 0), (10, 48, 0))
    seen["pointed"] = settled(window)
    phone.page.click("#place")
    for _ in range(100):
        items = server.annotations()["items"]
        if items:
            break
        time.sleep(0.05)
    seen["said"] = phone.page.inner_text("#state")
    seen["placed"] = [entry["item"] for entry in items]
    # A click on the same pixel: each line of the picture is two of the frame.
    window.page.mouse.click(480, 2 * (270 - 54))
    seen["clicked"] = settled(window)
    # While Place is held, up by a fifth of 5 degrees: 18 lines.
    phone.gesture("place", (10, 48, 0), (10, 51, 0), (10, 53, 0))
    seen["steadied"] = settled(window)
    window.page.mouse.click(480, 2 * (270 - 54 - 18))
    seen["clicked_above"] = settled(window)
    # The space bar presses the button, too.
    phone.page.focus("#place")
    phone.page.keyboard.press("Space")
    for _ in range(100):
        if len(server.annotations()["items"]) == 3:
            break
        time.sleep(0.05)
    seen["count"] = len(server.annotations()["items"])
    # The head's farthest place is 100 mm from its centre.
    window.key("m")
    window.page.wait_for_timeout(1200)
    seen["inside"] = window.page.inner_text("#comfort")
    server.add_points(behind=[0, 400, 0], back=[0, 350, 0])
    window.wait("document.getElementById('comfort').innerText !== ''", 60)
    settled(window)
    window.page.wait_for_timeout(1200)
    seen["outside"] = window.page.inner_text("#comfort")
    seen["problems"] = window.problems + phone.problems
    return seen


#: A phone that WebXR tracks, as a script: window.held(position, orientation) is where it is, in m; nothing is not known.
TRACKED = """
  let pose = null;
  let step = null;
  const session = new EventTarget();
  Object.assign(session, {
    updateRenderState: async () => {},
    requestReferenceSpace: async (kind) => kind,
    requestAnimationFrame: (next) => { step = next; },
    end: () => session.dispatchEvent(new Event("end")),
  });
  window.XRWebGLLayer = class {};
  const xr = { isSessionSupported: async (mode) => mode === "immersive-ar", requestSession: async () => session };
  Object.defineProperty(navigator, "xr", { value: xr });
  window.held = (position, orientation) => {
    const [[x, y, z], [qx, qy, qz, qw]] = [position ?? [0, 0, 0], orientation ?? [0, 0, 0, 1]];
    pose = position && { transform: { position: { x, y, z }, orientation: { x: qx, y: qy, z: qz, w: qw } } };
    step?.(0, { getViewerPose: (space) => (space === "local" ? pose : null) });
  };
"""


def tracked(browser, server):
    """The view after a phone that is tracked in space was moved and turned with Turn held."""
    window = Window(browser, server, "/kiosk?caption=false&view=space&preset=bone&size=960x540")
    window.wait("document.documentElement.dataset.still === 'true'")
    phone = Phone(browser, f"{server.url}/wand?view=space", TRACKED)
    phone.until("document.documentElement.dataset.connection === 'live' && !document.getElementById('space').hidden")
    seen = {"violations": accessibility(phone)["violations"]}
    phone.page.click("#space")
    phone.until("document.getElementById('space').getAttribute('aria-pressed') === 'true'")
    phone.page.evaluate("held(null)")
    seen["unknown"] = phone.page.inner_text("#hint")
    seen["before"] = settled(window)
    # Held upright; moved to the right by 40 mm and up by 20 mm, then turned to the left by 30 degrees as well.
    phone.page.evaluate("held([0, 0, 0], [0, 0, 0, 1])")
    box = phone.page.locator("#turn").bounding_box()
    phone.page.mouse.move(box["x"] + 20, box["y"] + 20)
    phone.page.mouse.down()
    for share in range(1, 5):
        phone.page.evaluate(f"held([{0.01 * share}, {0.005 * share}, 0], [0, 0, 0, 1])")
        phone.page.wait_for_timeout(60)
    seen["moved"] = settled(window)
    phone.page.evaluate("held([0.04, 0.02, 0], [0, Math.sin(Math.PI / 12), 0, Math.cos(Math.PI / 12)])")
    phone.page.wait_for_timeout(300)
    phone.page.mouse.up()
    seen["turned"] = settled(window)
    phone.page.click("#space")
    phone.until("document.getElementById('space').getAttribute('aria-pressed') === 'false'")
    seen["problems"] = window.problems + phone.problems
    return seen


#: A SpaceMouse behind WebHID, as a script: window.cap(id, numbers) is a report. window.reportTimes(id) are the
#: times of the reports with this number, s. The clock stands still while the page takes a report.
CAP = """
  const times = {};
  window.reportTimes = (reportId) => times[reportId];
  const device = new EventTarget();
  Object.assign(device, { vendorId: 0x256f, productId: 0xc652, opened: true });
  const hid = new EventTarget();
  Object.assign(hid, { getDevices: async () => [device], requestDevice: async () => [device] });
  Object.defineProperty(navigator, "hid", { value: hid });
  window.cap = (reportId, numbers) => {
    const data = new DataView(reportId === 3 ? Uint8Array.from(numbers).buffer : Int16Array.from(numbers).buffer);
    const now = performance.now();
    (times[reportId] ??= []).push(now / 1000);
    performance.now = () => now;
    device.dispatchEvent(Object.assign(new Event("inputreport"), { reportId, data }));
    delete performance.now;
  };
"""


def capped(browser, server):
    """The view after the cap was turned, and after it moved the cursor."""
    context = browser.new_context(viewport={"width": 1280, "height": 720})
    context.add_init_script(CAP)
    window = Window.__new__(Window)
    window.page, window.problems = context.new_page(), []
    window.page.on("pageerror", lambda error: window.problems.append(error.message))
    window.page.goto(f"{server.url}/kiosk?caption=false&preset=bone&size=960x540")
    window.wait("document.documentElement.dataset.still === 'true'")
    seen = {"before": settled(window)}
    for _ in range(20):
        window.page.evaluate("cap(2, [0, 0, 350])")
        window.page.wait_for_timeout(20)
    seen["turned"] = settled(window)
    window.page.mouse.click(480, 540)
    seen["clicked"] = settled(window)
    window.page.evaluate("cap(3, [1])")
    for _ in range(20):
        window.page.evaluate("cap(1, [350, 0, 0])")
        window.page.wait_for_timeout(20)
    window.page.evaluate("cap(3, [0])")
    seen["moved"] = settled(window)
    seen["times_s"] = {"turn": window.page.evaluate("reportTimes(2)"), "shift": window.page.evaluate("reportTimes(1)")}
    seen["problems"] = window.problems
    context.close()
    return seen


def guarded(browser):
    """With tokens, the code opens one session on a phone that is not signed in."""
    tokens = pathlib.Path(FOLDER) / "tokens"
    made = subprocess.run([RELIEF, "token", "add", tokens, "--name", "vera", "--scope", "annotate"], check=True, capture_output=True, text=True)
    token = made.stdout.split()[-1]
    process = subprocess.Popen(
        [RELIEF, "serve", "--series", SERIES, "--listen", "127.0.0.1:0", "--token-file", tokens], stdout=subprocess.PIPE, text=True
    )
    try:
        return paired_by_ticket(browser, process.stdout.readline().split()[-1].rstrip("/"), token)
    finally:
        process.kill()


def paired_by_ticket(browser, url, token):
    page = browser.new_context().new_page()
    page.goto(f"{url}/kiosk?view=theatre")
    page.wait_for_selector("input")
    page.fill("input", token)
    page.keyboard.press("Enter")
    page.wait_for_selector("#frame")
    for _ in range(200):
        if page.evaluate("document.documentElement.dataset.connection") == "live":
            break
        page.wait_for_timeout(100)
    page.keyboard.press("p")
    page.wait_for_selector("#wand-code", state="visible")
    read = decoded(page)
    address = page.get_attribute("#wand-address", "href")
    seen = {"has_ticket": "ticket=" in address, "is_read": read == address}
    first = Phone(browser, address)
    first.until("document.documentElement.dataset.connection === 'live'")
    second = Phone(browser, address)
    second.until("document.documentElement.dataset.connection === 'ended'")
    seen["second"] = second.page.inner_text("#state")
    return seen


with sync_playwright() as playwright:
    browser = launched(playwright, CHROMIUM)
    server = Server(RELIEF, SERIES, "--annotations", str(pathlib.Path(FOLDER) / "wand.db"))
    try:
        seen = {"open": driven(browser, server), "space": tracked(browser, server), "cap": capped(browser, server)}
        print(json.dumps({**seen, "guarded": guarded(browser)}))
    finally:
        server.kill()
    browser.close()
