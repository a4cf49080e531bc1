"""The screen in space of the kiosk, with a WebXR device that a script plays.

The device's projections are those of Kooima for a screen that fills the picture of each eye, so each pixel of an eye's picture is
one of its view. Poses are those of a head that is turned by 30 degrees and moves along the screen.
"""

import base64
import io
import math

import numpy
from PIL import Image

SIZE = (480, 270)
#: A screen of 40 inches, seen from 600 mm, m.
WIDTH = 40 * 25.4 * 16 / math.hypot(16, 9) / 1000
DISTANCE = 0.6
EYES = 0.065
YAW = math.radians(30)
ADDRESS = f"/kiosk?caption=false&preset=bone&size={SIZE[0]}x{SIZE[1]}&output=stereo&rest=synthesised&inches=40&distance=600&span=1"

#: window.look(views) shows a picture for these views and gives it as a data URL.
DEVICE = """
  let step = null;
  const session = new EventTarget();
  Object.assign(session, {
    updateRenderState: async () => {},
    requestReferenceSpace: async (kind) => kind,
    requestAnimationFrame: (next) => { step = next; },
    end: () => session.dispatchEvent(new Event("end")),
  });
  let canvas = null;
  window.XRWebGLLayer = class {
    framebuffer = null;
    constructor(_, context) {
      canvas = context.canvas;
      [canvas.width, canvas.height] = [960, 270];
    }
    getViewport({ eye }) { return { x: eye === "left" ? 0 : 480, y: 0, width: 480, height: 270 }; }
  };
  Object.defineProperty(navigator, "xr", { value: {
    isSessionSupported: async (mode) => mode === "immersive-vr", requestSession: async () => session,
  } });
  window.look = (transform, views) => {
    const now = step;
    now(0, { getViewerPose: (space) => (space === "local" ? { transform, views } : null) });
    return canvas.toDataURL();
  };
"""


def matrix(rows):
    """By columns, as WebXR has them."""
    return [float(value) for value in numpy.array(rows, dtype=float).T.ravel()]


def pose(aside):
    """The pose of a head, and its views: at head height, turned to the left, moved aside along the screen, m."""
    right, back = numpy.array([math.cos(YAW), 0, -math.sin(YAW)]), numpy.array([math.sin(YAW), 0, math.cos(YAW)])
    up = numpy.array([0.0, 1, 0])
    head = numpy.array([0.3, 1.5, -0.2]) + aside * right
    orientation = {"x": 0, "y": math.sin(YAW / 2), "z": 0, "w": math.cos(YAW / 2)}
    place = lambda at: {"x": at[0], "y": at[1], "z": at[2]}
    near, far = 0.1, 100
    height = WIDTH * SIZE[1] / SIZE[0]
    views = []
    for eye, side in [("left", -0.5), ("right", 0.5)]:
        at = head + side * EYES * right
        # The edges of the screen at the near plane, for an eye that is aside of its middle.
        off = aside + side * EYES
        left, end, top = [(edge * near) / DISTANCE for edge in (-WIDTH / 2 - off, WIDTH / 2 - off, height / 2)]
        projection = [
            [2 * near / (end - left), 0, (end + left) / (end - left), 0],
            [0, near / top, 0, 0],
            [0, 0, -(far + near) / (far - near), -2 * far * near / (far - near)],
            [0, 0, -1, 0],
        ]
        turn = numpy.array([right, up, back])
        inverse = numpy.eye(4)
        inverse[:3, :3], inverse[:3, 3] = turn, -turn @ at
        transform = {"position": place(at), "orientation": orientation, "inverse": {"matrix": matrix(inverse)}}
        views.append({"eye": eye, "projectionMatrix": matrix(projection), "transform": transform})
    return {"position": place(head), "orientation": orientation}, views


def picture(url):
    return numpy.asarray(Image.open(io.BytesIO(base64.b64decode(url.split(",")[1]))).convert("RGB")).astype(int)


def seen(browser, server, page_of, wait_for, wait_still, pixels):
    """Both views on the screen in space, at rest and from 130 mm aside, against the views that the page shows itself."""
    opened = page_of(browser, f"{server.url}{ADDRESS}", DEVICE)
    page, problems = opened
    wait_still(page)
    page.keyboard.press("m")
    found = {"offered": page.is_visible("#space")}
    page.click("#space")
    wait_for(page, "document.documentElement.dataset.space !== undefined")
    page.keyboard.press("m")
    for name, aside, more in [("rest", 0, ""), ("aside", 0.13, "&eye=2")]:
        before = int(page.evaluate("document.documentElement.dataset.eyes ?? 0"))
        look = "([transform, views]) => { const step = () => look(transform, views); return step(); }"
        page.evaluate(look, pose(aside))
        wait_for(page, f"Number(document.documentElement.dataset.eyes ?? 0) > {before}")
        page.wait_for_timeout(300)
        shown = picture(page.evaluate(look, pose(aside)))
        other, _ = page_of(browser, f"{server.url}{ADDRESS}{more}")
        wait_still(other)
        expected = pixels(other.locator("#frame").screenshot())
        other.close()
        found[name] = {"different": int((abs(shown - expected) > 1).any(axis=2).sum()), "lit": int((expected > 40).any(axis=2).sum())}
    page.keyboard.press("v")
    wait_for(page, "document.documentElement.dataset.space === undefined")
    found["problems"] = problems
    page.close()
    return found
