"""The widget relief.Viewer in JupyterLab, in a browser.

usage: test_jupyterlab.py    with the package and its peers on the path and RELIEF_DOCS the folder docs; RELIEF_CHROMIUM names a
browser that goes by another name, RELIEF_PAGE_SHOTS=FOLDER keeps pictures
"""

import base64
import io
import json
import os
import pathlib
import re
import shutil
import socket
import subprocess
import sys
import tempfile
import time
import unittest
import urllib.request

import axe_playwright_python
import numpy
from PIL import Image
from playwright.sync_api import sync_playwright

import relief

NOTEBOOK = pathlib.Path(os.environ["RELIEF_DOCS"]) / "notebooks" / "landmarks.ipynb"
NAMES = ["chromium", "chromium-browser", "google-chrome"]
CHROMIUM = os.environ.get("RELIEF_CHROMIUM") or next(filter(None, map(shutil.which, NAMES)), None)
SHOTS = os.environ.get("RELIEF_PAGE_SHOTS")
AXE = (pathlib.Path(axe_playwright_python.__file__).parent / "axe.min.js").read_text(encoding="utf-8")
CANVAS = "document.querySelector('.relief-picture')"


def free_port():
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


class Lab:
    """JupyterLab with this notebook, on loopback."""

    def __init__(self, folder):
        shutil.copy(NOTEBOOK, folder / "landmarks.ipynb")
        port = free_port()
        self.url = f"http://127.0.0.1:{port}/lab/tree/landmarks.ipynb?reset"
        homes = {name: str(folder / name) for name in ["HOME", "JUPYTER_CONFIG_DIR", "JUPYTER_DATA_DIR", "JUPYTER_RUNTIME_DIR"]}
        options = [f"--ServerApp.port={port}", f"--ServerApp.root_dir={folder}", "--IdentityProvider.token=", "--ServerApp.disable_check_xsrf=True"]
        command = [sys.executable, "-m", "jupyterlab", "--no-browser", "--allow-root", *options]
        self.log = open(folder / "lab.log", "wb")
        self.process = subprocess.Popen(command, stdout=self.log, stderr=self.log, env={**os.environ, **homes})
        for _ in range(600):
            try:
                self.start_kernel(f"http://127.0.0.1:{port}/api/sessions")
                return
            except OSError:
                time.sleep(0.1)
        self.close()
        raise RuntimeError((folder / "lab.log").read_text(encoding="utf-8"))

    def start_kernel(self, url):
        """Starts the notebook's kernel. A page that starts it itself forgets cells that are run too early."""
        session = {"path": "landmarks.ipynb", "name": "landmarks.ipynb", "type": "notebook", "kernel": {"name": "python3"}}
        request = urllib.request.Request(url, json.dumps(session).encode(), {"Content-Type": "application/json"})
        urllib.request.urlopen(request, timeout=30).close()

    def close(self):
        self.process.terminate()
        try:
            self.process.wait(20)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self.log.close()


def psnr(one, other):
    error = numpy.mean((one.astype(numpy.float64) - other) ** 2)
    return 10 * numpy.log10(255**2 / max(error, 1e-9))


@unittest.skipUnless(CHROMIUM, "SKIPPED: the widget in JupyterLab (there is no browser)")
class Widget(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        lab = Lab(pathlib.Path(folder.name))
        self.addCleanup(lab.close)
        playwright = sync_playwright().start()
        self.addCleanup(playwright.stop)
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"])
        self.addCleanup(browser.close)
        self.page = browser.new_page(viewport={"width": 1200, "height": 1400})
        self.problems, self.from_kernel, self.ran = [], [], 0
        # JupyterLab's own: it forgets the answer to a request for a thread of the kernel.
        own = "create_subshell_request"
        self.page.on("pageerror", lambda error: None if own in str(error) else self.problems.append(str(error)))
        self.page.on("websocket", lambda socket: self.listen(socket) if "/channels" in socket.url else None)
        self.page.goto(lab.url)

    def listen(self, socket):
        """Counts the messages of a kernel to the page."""
        socket.on("framereceived", lambda _: self.from_kernel.append(socket.url))

    def wait(self, condition, seconds=120):
        """Waits for a condition; Jupyter's content policy refuses Playwright's way to do so in the page."""
        end = time.monotonic() + seconds
        while not self.page.evaluate(f"Boolean({condition})"):
            if time.monotonic() > end:
                self.fail(f"after {seconds} s still not: {condition}; the page has: {self.page.inner_text('.jp-Notebook')}")
            self.page.wait_for_timeout(100)

    def shot(self, name):
        if SHOTS:
            self.middle()
            self.page.screenshot(path=f"{SHOTS}/{name}.png")

    def picture(self):
        """The pixels of the canvas."""
        data = self.page.evaluate(f"{CANVAS}.toDataURL('image/png')").split(",")[1]
        return numpy.asarray(Image.open(io.BytesIO(base64.b64decode(data))).convert("RGB"))

    def shows(self, expected, least_db):
        """Waits until the canvas shows a picture."""
        for _ in range(400):
            self.page.wait_for_timeout(300)
            found = psnr(self.picture(), expected)
            if found > least_db:
                return
        self.fail(f"the canvas is {found:.1f} dB from what is expected, not {least_db}")

    def shows_another(self, than, most_db):
        """Waits until the canvas shows another picture."""
        for _ in range(400):
            self.page.wait_for_timeout(300)
            if psnr(self.picture(), than) < most_db:
                return
        self.fail("the canvas shows the same picture")

    def middle(self):
        """The middle of the canvas in the window, scrolled to."""
        canvas = self.page.locator(".relief-picture")
        canvas.scroll_into_view_if_needed()
        self.page.wait_for_timeout(300)
        box = canvas.bounding_box()
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def run_all(self):
        """Runs all cells, once the page hears the kernel. Before, its indicator says idle too, and cells that are run start
        further kernels."""
        page = self.page
        for _ in range(1200):
            if self.from_kernel:
                break
            page.wait_for_timeout(100)
        else:
            self.fail("the page hears nothing of the kernel")
        page.wait_for_selector(".jp-Notebook-ExecutionIndicator[data-status=idle]", timeout=60000)
        page.get_by_role("menuitem", name="Run", exact=True).click()
        page.get_by_role("menuitem", name=re.compile("^Run All Cells")).click()
        prompts = "[...document.querySelectorAll('.jp-CodeCell .jp-InputPrompt')].map((one) => one.textContent)"
        self.wait(f"{prompts}.every((text) => /[0-9]/.test(text))")

    def run_code(self, text):
        """Runs code in a new cell at the end; gives what it prints."""
        page = self.page
        self.ran += 1
        mark = f"end of {self.ran}"
        page.locator(".jp-Notebook .jp-Cell").last.click(position={"x": 8, "y": 8})
        page.keyboard.press("Escape")
        page.keyboard.press("b")
        page.keyboard.press("Enter")
        page.keyboard.insert_text(f"{text}\nprint({mark!r})")
        page.keyboard.press("Shift+Enter")
        output = page.locator(".jp-OutputArea-output pre", has_text=mark).last
        output.wait_for(timeout=60000)
        return output.inner_text()

    def test_a_volume_turns_live_in_jupyterlab(self):
        page = self.page
        page.wait_for_selector(".jp-Notebook .jp-Cell", timeout=60000)
        self.run_all()
        self.wait(f"{CANVAS}?.dataset.frame && document.querySelector('.relief-bar select').value === 'bone'")

        # The notebook ends with this view: its camera looks from there, and its picture is that of the camera.
        volume = relief.phantom("head", 128)
        scene = {"shading": {"ambient": 0.3}}
        self.page.wait_for_timeout(2000)
        camera = json.loads(self.run_code("import json; print(json.dumps(viewer.camera))").splitlines()[0])
        towards = numpy.subtract(camera["eye_mm"], camera["look_at_mm"])
        azimuth, elevation = numpy.radians([40, 15])
        cosine = numpy.cos(elevation)
        direction = [numpy.sin(azimuth) * cosine, -numpy.cos(azimuth) * cosine, numpy.sin(elevation)]
        numpy.testing.assert_allclose(towards / numpy.linalg.norm(towards), direction, atol=1e-5)
        expected = volume.render(scene, preset="bone", camera=camera, size=(640, 480)).color[..., :3]
        self.shows(expected, 33)
        self.shot("jupyter-bone")

        # A preset of the menu brings its own light.
        page.locator(".relief-bar select").select_option("skin")
        front = volume.render(preset="skin", camera=camera, size=(640, 480))
        self.shows(front.color[..., :3], 33)

        # A click sets the cursor where the picture's own pick is.
        page.mouse.click(*self.middle())
        self.wait("document.querySelector('.relief-status').textContent.includes('mm (LPS)')")
        text = self.run_code("print([*viewer.cursor_mm])")
        numpy.testing.assert_allclose(json.loads(text.splitlines()[0]), front.pick(320, 240), atol=1.0)

        # Dragging turns the volume to the view that the kernel knows as its camera.
        before = self.picture()
        middle = self.middle()
        page.mouse.move(*middle)
        page.mouse.down()
        for step in range(1, 11):
            page.mouse.move(middle[0] + 10 * step, middle[1])
        page.mouse.up()
        self.shows_another(before, 30)
        self.page.wait_for_timeout(2000)
        text = self.run_code("print(json.dumps(viewer.camera))")
        turned = volume.render(preset="skin", camera=json.loads(text.splitlines()[0]), size=(640, 480)).color[..., :3]
        self.shows(turned, 25)  # the cursor is drawn into the one, not into the other
        self.shot("jupyter-skin")

        # Keys and the button.
        page.locator(".relief-picture").focus()
        page.keyboard.press("ArrowLeft")
        page.keyboard.press("+")
        self.shows_another(turned, 24)
        page.get_by_role("button", name="Reset view").click()

        # A refusal is shown.
        self.run_code("viewer.change({'mood': 1})")
        self.wait("document.querySelector('.relief-status').textContent.includes('mood')")
        page.evaluate(AXE)
        violations = page.evaluate("axe.run('.relief-viewer').then(({ violations }) => violations.map(({ id, nodes }) => [id, nodes[0].html]))")
        self.assertEqual(violations, [])
        self.run_code("viewer.close()")
        self.assertEqual(self.problems, [])


if __name__ == "__main__":
    unittest.main(verbosity=2)
