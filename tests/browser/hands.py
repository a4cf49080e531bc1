"""Drives structures, curves, snapping, fingers and linked views of the page for annotations, and prints its findings as one JSON object.

usage: hands.py RELIEF CHROMIUM SERIES FOLDER [STEP,...]

RELIEF serves SERIES and keeps annotations in FOLDER.
"""

import json
import math
import pathlib
import sys

from pages import Page, Server, launched
from playwright.sync_api import sync_playwright

RELIEF, CHROMIUM, SERIES, FOLDER = sys.argv[1:5]
PANES = ["volume", "axial", "sagittal", "coronal", "oblique"]


def links(page, server):
    """A click in each view: the cursor is where that view's pick says, and all slices go through it."""
    found = {}
    page.key("v")
    for pane, at in zip(PANES, [(0.5, 0.4), (0.42, 0.45), (0.6, 0.5), (0.45, 0.55), (0.55, 0.42)]):
        page.still()
        picked = page.pick(pane, *at)
        before = page.page.get_attribute("#readout", "data-mm")
        page.click(pane, *at)
        page.wait(f"document.getElementById('readout').dataset.mm !== {json.dumps(before)}")
        page.still()
        cursor = [float(mm) for mm in page.page.get_attribute("#readout", "data-mm").split(",")]
        slices = {name: page.asked[name] for name in PANES[1:]}
        # The mark of the cursor in 3D, and where the lines of the slices meet, in fractions of each view.
        meets = page.page.evaluate(
            "Object.fromEntries([...document.querySelectorAll('.pane:not(.pane-volume)')].map((pane) => {"
            " const lines = [...pane.querySelectorAll('.cross')].map((line) => ['x1', 'y1', 'x2', 'y2'].map((name) => Number(line.getAttribute(name))));"
            " const [a, b] = [lines[0], lines[1]]; return [pane.dataset.pane, [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2, pane.clientWidth, pane.clientHeight]]; }))"
        )
        mark = page.page.evaluate(
            "(() => { const mark = document.querySelector('.pane-volume .cross-middle'); const pane = document.querySelector('.pane-volume');"
            " return [Number(mark.getAttribute('cx')) / pane.clientWidth, Number(mark.getAttribute('cy')) / pane.clientHeight]; })()"
        )
        found[pane] = {"picked": picked, "cursor": cursor, "slices": slices, "meets": meets, "mark": mark, "at": list(at)}
    return found


def painting(page, server):
    """A ball, another one beside it, that one erased, and the erasing taken back."""
    page.key("b")
    page.page.fill("#paint-radius", "12")
    page.page.locator("#paint-radius").blur()

    def region(version):
        for _ in range(600):
            entry = server.item("Region 1")
            if entry["version"] >= version:
                page.still()
                return entry["item"]["geometry"]["volume_ml"]
            page.page.wait_for_timeout(50)
        raise SystemExit(f"no version {version} of the region; {page.page.inner_text('#notice')}")

    page.still()
    page.click("axial", 0.4, 0.5)
    found = {"one": region(1)}
    page.wait_row("Region 1")
    page.click("axial", 0.6, 0.5)
    found["two"] = region(2)
    page.page.select_option("#paint-mode", "erase")
    page.shot("painted")
    page.click("axial", 0.6, 0.5)
    found["erased"] = region(3)
    page.key("Control+z")
    found["undone"] = region(4)
    page.page.select_option("#paint-mode", "add")
    page.key("v")
    return found


def filling(page, server):
    """Round contours on three levels, closed by clicks, and the region between them."""
    page.key("o")
    page.page.locator(".pane-axial").focus()
    heights = []
    for level in range(3):
        page.still()
        box = page.box("axial")
        radius = 0.2 * min(box["width"], box["height"])
        middle = [box["x"] + box["width"] / 2, box["y"] + box["height"] / 2]
        for corner in range(9):
            angle = math.radians(45 * corner)
            page.page.mouse.click(round(middle[0] + radius * math.cos(angle)), round(middle[1] + radius * math.sin(angle)))
            page.page.wait_for_timeout(120)
        made = server.item(f"Contour {level + 1}")
        heights.append(made["item"]["geometry"]["points_mm"][0][2])
        page.wait_row(f"Contour {level + 1}")
        for _ in range(2):
            page.key("Shift+PageUp")
    per_pixel = float(page.asked["axial"]["height_mm"]) / box["height"]
    curves = [server.item(f"Contour {level}") for level in (1, 2, 3)]
    found = {
        "radius_mm": radius * per_pixel, "heights": heights, "closed": [curve["item"]["geometry"]["closed"] for curve in curves],
        "points": [len(curve["item"]["geometry"]["points_mm"]) for curve in curves],
    }
    page.page.click('button[aria-label="Region between these 3 contours"]')
    found["region"] = server.item("Region 2")["item"]["geometry"]
    page.wait_row("Region 2")
    page.still()
    page.shot("filled")
    page.key("v")
    return found


def curve(page, server):
    """A point added on the line of a curve, dragged, removed again, and none that it cannot do without."""
    page.key("c")
    page.page.locator(".pane-coronal").focus()
    for at in [(0.3, 0.4), (0.5, 0.3), (0.7, 0.45)]:
        page.still()
        page.click("coronal", *at)
        page.page.wait_for_timeout(150)
    page.key("Enter")
    geometry = lambda: server.item("Curve 1")["item"]["geometry"]
    found = {"made": geometry()["points_mm"]}
    page.wait_row("Curve 1")
    page.key("e")
    page.still()
    # A quarter of the way along the line as it is drawn.
    at = page.page.evaluate(
        "(() => { const pane = document.querySelector('.pane-coronal'); const path = pane.querySelector('.overlay path.chosen');"
        " const at = path.getPointAtLength(path.getTotalLength() / 4); const box = pane.getBoundingClientRect();"
        " return [box.x + at.x, box.y + at.y]; })()"
    )
    page.page.mouse.move(*at)
    page.wait("document.querySelector('.pane-coronal').classList.contains('adds')")
    box = page.box("coronal")
    pressed = page.pick("coronal", (round(at[0]) - box["x"]) / box["width"], (round(at[1]) - box["y"]) / box["height"])
    page.page.mouse.move(round(at[0]), round(at[1]))
    page.page.mouse.down()
    page.page.mouse.up()
    count = lambda: len(geometry()["points_mm"])
    wait_count(page, count, 4)
    found["added"] = {"points": geometry()["points_mm"], "pressed": pressed}
    page.still()
    page.shot("curve")
    page.key("Backspace")
    wait_count(page, count, 3)
    found["removed"] = geometry()["points_mm"]
    page.wait("!document.getElementById('remove-point').disabled")
    page.page.click("#remove-point")
    wait_count(page, count, 2)
    page.wait("document.getElementById('remove-point').disabled")
    page.page.locator(".pane-coronal").focus()
    page.key("Backspace")
    page.wait("document.getElementById('notice').innerText.includes('needs its 2 points')")
    found["least"] = count()
    for _ in range(2):
        before = count()
        page.key("Control+z")
        wait_count(page, count, before + 1)
    found["undone"] = geometry()["points_mm"]
    page.key("v")
    return found


def wait_count(page, count, wanted):
    for _ in range(600):
        if count() == wanted:
            return
        page.page.wait_for_timeout(50)
    page.shot("stuck")
    raise SystemExit(f"{count()} points, not {wanted}; {page.page.inner_text('#notice')}")


def sight(page, server):
    """A snap in 3D goes along the line of sight; one in a slice does not say any."""
    page.key("p")
    page.page.select_option("#snap-to", "gradient")
    sent = []
    page.page.on("request", lambda request: request.url.endswith("/snap") and sent.append(json.loads(request.post_data)))
    page.still()
    page.click("volume", 0.5, 0.4)
    item = server.item("Point 1")["item"]
    page.still()
    found = {"placement": item["placement"], "at_mm": item["geometry"]["at_mm"], "ray": sent[-1].get("ray")}
    page.click("coronal", 0.35, 0.35)
    server.item("Point 2")
    page.still()
    found["in_slice"] = sent[-1].get("ray")
    page.page.select_option("#snap-to", "off")
    page.key("v")
    return found


def fingers(browser, server):
    """Two fingers on a slice and in 3D: closer by what they part, along by what they move."""
    page = Page(browser, server, "Ada Berg", has_touch=True)
    client = page.context.new_cdp_session(page.page)
    found = {}
    for pane in ["axial", "volume"]:
        page.still()
        before = dict(page.asked[pane])
        box = page.box(pane)
        start = [round(box["x"] + 0.4 * box["width"]), round(box["y"] + 0.45 * box["height"])]
        steps = [(30 + 3 * step, 4 * step, 2 * step) for step in range(11)]

        def touch(kind, half, dx, dy):
            points = [{"x": start[0] + dx + side * half, "y": start[1] + dy, "id": number} for number, side in enumerate((-1, 1))]
            client.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [] if kind == "touchEnd" else points})
            page.page.wait_for_timeout(30)

        touch("touchStart", *steps[0])
        for step in steps[1:]:
            touch("touchMove", *step)
        touch("touchEnd", *steps[-1])
        page.page.wait_for_timeout(300)
        page.still()
        at = lambda dx, dy: [(start[0] + dx - box["x"]) / box["width"], (start[1] + dy - box["y"]) / box["height"]]
        found[pane] = {
            "before": before, "after": dict(page.asked[pane]), "from": at(0, 0), "to": at(40, 20), "aspect": box["width"] / box["height"],
            "size": [box["width"], box["height"]],
        }
        page.shot(f"fingers-{pane}")
    volume = server.volumes[0]
    found["volume"]["center_mm"] = volume["framing"]["center_mm"]
    found["volume"]["radius_mm"] = volume["framing"]["radius_mm"]
    found["items"] = len(server.annotations()["items"])
    found["problems"] = page.problems
    page.context.close()
    return found


def jobs(page, server):
    """A task that hangs is displayed and cancelled: nothing is made, and the page works afterwards."""
    held = []
    page.page.route("**/annotations/mesh", lambda route: held.append(route))
    count = len(server.annotations()["items"])
    page.page.click('.item[data-name="Region 1"] .item-main')
    page.page.click('.item[data-name="Region 1"] button[aria-label="Mesh of Region 1"]')
    page.wait("!document.getElementById('job').hidden")
    page.page.wait_for_timeout(1100)
    page.shot("job")
    found = {"said": page.page.inner_text("#job"), "bar": page.page.evaluate("document.querySelector('#job progress').position")}
    page.page.click("#job button")
    page.wait("document.getElementById('job').hidden && document.getElementById('brief').innerText.includes('Broken off')")
    found["items"] = [count, len(server.annotations()["items"])]
    page.page.unroute("**/annotations/mesh")
    page.page.click('.item[data-name="Region 1"] button[aria-label="Mesh of Region 1"]')
    found["mesh"] = server.item("Region 1 mesh")["item"]["geometry"]["kind"]
    return found


def cine(page, server):
    """A slice pane plays its slices by its button and by the space bar, and the 3D view is cut by a plane."""
    at = lambda: page.page.inner_text(".pane-axial .pane-at")
    number = "Number(document.querySelector('.pane-axial .pane-at').innerText.split('/')[0])"
    found = {"first": at()}
    before = page.page.evaluate(number)
    page.page.hover(".pane-axial")
    page.page.click(".pane-axial .pane-cine")
    page.wait(f"Math.abs({number} - {before}) >= 3", 60)
    found["playing"] = page.page.get_attribute(".pane-axial .pane-cine", "aria-pressed")
    page.shot("cine")
    page.page.focus(".pane-axial")
    page.key(" ")
    found["stopped"] = page.page.get_attribute(".pane-axial .pane-cine", "aria-pressed")
    page.still()
    found["last"] = at()
    page.page.click("#crop-group summary")
    page.page.click("#crop-add-plane")
    page.still()
    found["plane"] = page.asked["volume"].get("clip_planes_mm")
    page.shot("plane")
    page.page.click("#crop-reset")
    page.still()
    found["whole"] = page.asked["volume"].get("clip_planes_mm")
    page.page.click("#crop-group summary")
    return found


def late(page, server):
    """A slice that moves away and back while pictures come late: the last one displayed is complete."""
    held, holds = [], True

    def hold(route):
        if holds and route.request.headers["accept"] == "image/jpeg" and "plane=axial" in route.request.url:
            held.append(route)
        else:
            route.continue_()

    page.still()
    before = page.page.get_attribute(".pane-axial", "data-pictures")
    page.page.route("**/slice?*", hold)
    page.page.locator(".pane-axial").focus()
    page.key("Control+ArrowRight")
    page.key("Control+ArrowLeft")
    page.page.wait_for_timeout(500)
    holds = False
    for route in held:
        route.continue_()
    page.wait(f"document.querySelector('.pane-axial').dataset.pictures > {before} + 1")
    page.still()
    page.page.unroute("**/slice?*")
    return {"held": len(held)}


def main():
    steps = sys.argv[5].split(",") if len(sys.argv) > 5 else []
    server = Server(RELIEF, SERIES, "--annotations", str(pathlib.Path(FOLDER) / "hands.db"))
    try:
        with sync_playwright() as playwright:
            browser = launched(playwright, CHROMIUM)
            page = Page(browser, server, "Ada Berg")
            found = {}
            for name, step in [("links", links), ("painting", painting), ("filling", filling), ("curve", curve), ("sight", sight), ("jobs", jobs), ("cine", cine), ("late", late)]:
                if not steps or name in steps:
                    found[name] = step(page, server)
            if not steps or "fingers" in steps:
                found["fingers"] = fingers(browser, server)
            found["problems"] = page.problems
        print(json.dumps(found))
    finally:
        server.kill()


main()
