"""Drives the page of the volume, and looks at all pages on screens large and small; prints its findings as one JSON object.

usage: views.py RELIEF CHROMIUM SERIES FOLDER [STEP,...]
"""

import base64
import io
import json
import pathlib
import subprocess
import sys
import time
import urllib.parse
import urllib.request

import numpy
from PIL import Image

from pages import Page, Server, Window, accessibility, launched, settled
from playwright.sync_api import sync_playwright

RELIEF, CHROMIUM, SERIES, FOLDER = sys.argv[1:5]
SIZES = {"desk": {"width": 1400, "height": 900}, "phone": {"width": 390, "height": 844}}
ADDRESSES = {"volume": "/", "annotate": "/annotate", "kiosk": "/kiosk?preset=bone", "monitor": "/monitor"}
#: Roles of the accessibility tree that people use.
USED = {"button", "link", "checkbox", "radio", "combobox", "slider", "spinbutton", "textbox", "switch", "ColorWell"}
#: What reaches out of the window, or is cut by it, though it can be used.
OUTSIDE = """
[...document.querySelectorAll('button, a, input, select, summary, label')].filter((control) => {
  const box = control.getBoundingClientRect();
  const style = getComputedStyle(control);
  if (box.width < 2 || style.visibility === 'hidden' || control.closest('[hidden], .for-readers')) return false;
  for (let host = control.parentElement; host; host = host.parentElement) {
    if (/auto|scroll/.test(getComputedStyle(host).overflowX)) return false;
  }
  return box.left < -1 || box.right > innerWidth + 1;
}).map((control) => control.outerHTML.slice(0, 90))
"""


def kept(page):
    page.page.wait_for_timeout(500)  # it is written every 400 ms at most
    return dict(urllib.parse.parse_qsl(page.page.evaluate("location.hash.slice(1)")))


def address(browser, server):
    """Choices are kept in the address, and come back from there."""
    page = Window(browser, server, "/#preset=skin&az=35&el=5&zoom=1.5")
    settled(page)
    page.page.check('input[name="preview"][value="anaglyph"]', force=True)
    page.page.fill("#factor", "100")
    page.page.check('input[name="overlay"][value="cube"]', force=True)
    page.wait("!document.getElementById('preview').hidden", 60)
    page.shot("preview")
    found = {"kept": kept(page)}
    page.page.reload()
    settled(page)
    page.wait("!document.getElementById('preview').hidden", 60)
    found["again"] = page.page.evaluate(
        "({ preview: document.querySelector('input[name=preview]:checked').value, factor: document.getElementById('factor').value,"
        " cube: document.querySelector('input[value=cube]').checked, preset: document.querySelector('.presets input:checked + img + span').innerText })"
    )
    page.page.check('input[name="preview"][value=""]', force=True)
    page.wait("document.getElementById('preview').hidden")
    found["off"] = kept(page).get("preview")
    found["problems"] = page.problems
    page.context.close()
    return found


def views_of(file, columns=3, rows=3):
    """The views of a quilt, from its PNG."""
    quilt = numpy.asarray(Image.open(file).convert("RGB")).astype(float)
    return [view for row in numpy.split(quilt, rows)[::-1] for view in numpy.split(row, columns, axis=1)]


def difference(browser, server):
    """How far made views are from true ones: the page's number and map, beside those of the pictures that it fetched and of files."""
    page = Window(browser, server, "/#preset=skin-and-bone&az=35&el=5")
    settled(page)
    fetched = {}
    page.page.on("request", lambda asked: fetched.update({"layout=views-9" in asked.url and urllib.parse.urlsplit(asked.url).path.split("/")[-1]: asked.url}))
    page.page.check('input[name="preview"][value="difference"]', force=True)
    page.wait("!document.getElementById('preview-words').hidden", 60)
    page.shot("difference")
    found = {"words": page.page.inner_text("#preview-words")}
    map_of_page = page.page.evaluate("document.getElementById('preview').toDataURL().split(',')[1]")
    made, true = (views_of(io.BytesIO(urllib.request.urlopen(fetched[part]).read())) for part in ("frame", "views"))
    squares = [(one - other) ** 2 for one, other in zip(made, true)]
    found["psnr"] = [10 * numpy.log10(255**2 / each.mean()) for each in squares if each.any()]
    found["expected_map"] = float(numpy.sqrt(numpy.mean(squares, axis=(0, 3))).mean() * 255 / 64)
    shown = numpy.asarray(Image.open(io.BytesIO(base64.b64decode(map_of_page))).convert("L"))
    found["map"] = float(shown.mean())
    asked = dict(urllib.parse.parse_qsl(urllib.parse.urlsplit(fetched["views"]).query))
    file, scene = f"{FOLDER}/true.png", pathlib.Path(FOLDER) / "true.json"
    scene.write_text(json.dumps({"display": {"factor": int(asked["factor"]), "offset": int(asked["offset"])}}))
    command = [RELIEF, "render", "--series", SERIES, "--preset", asked["preset"], "--azimuth-deg", asked["azimuth_deg"], "--elevation-deg",
               asked["elevation_deg"], "--frame", asked["frame"], "--size", asked["size_px"].replace(",", "x"), "--layout", "views-9", "--views", "true", "--adapter", "cpu",
               "--scene", scene, "--out", file]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    found["asked"] = asked
    found["from_file"] = max(float(numpy.abs(one - other).max()) for one, other in zip(true, views_of(file)))
    page.page.check('input[name="preview"][value=""]', force=True)
    page.wait("document.getElementById('preview-words').hidden")
    found["problems"] = page.problems
    page.context.close()
    return found


def hands(browser, server):
    """Mouse, fingers and keys move and zoom the volume and a slice; numbers that are typed are no commands."""
    page = Window(browser, server, "/#preset=bone&az=20&el=10&zoom=1", has_touch=True)
    settled(page)
    stage = page.page.locator("#stage").bounding_box()
    middle = [stage["x"] + stage["width"] / 2, stage["y"] + stage["height"] / 2]
    found = {"stage": [stage["width"], stage["height"]], "center_mm": server.volumes[0]["framing"]["center_mm"]}
    volume = server.volumes[0]
    found["radius_mm"] = volume["framing"]["radius_mm"]
    page.page.mouse.move(*middle)
    page.page.mouse.down(button="right")
    for step in range(1, 6):
        page.page.mouse.move(middle[0] + 10 * step, middle[1])
    page.page.mouse.up(button="right")
    settled(page)
    found["moved"] = {"kept": kept(page), "asked": dict(page.asked["volume"])}
    page.key("Home")
    settled(page)
    found["home"] = kept(page)
    page.key("Control+ArrowUp")
    settled(page)
    found["by_key"] = kept(page)
    page.key("Home")
    client = page.context.new_cdp_session(page.page)
    for kind, half in [("touchStart", 40), ("touchMove", 60), ("touchMove", 80), ("touchEnd", 80)]:
        points = [{"x": middle[0] + side * half, "y": middle[1], "id": number} for number, side in enumerate((-1, 1))]
        client.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [] if kind == "touchEnd" else points})
    settled(page)
    found["pinched"] = kept(page)
    page.page.check('input[name="plane"][value="axial"]', force=True)
    settled(page)
    page.page.fill("#slice-center", "")
    page.page.locator("#slice-center").press_sequentially("55")
    settled(page)
    found["typed"] = kept(page)
    page.key("Escape")
    found["problems"] = page.problems
    page.context.close()
    return found


def empty(browser):
    """A server without a series says what to do, and takes one."""
    server = Server(RELIEF, None)
    page = Window(browser, server, "/")
    page.wait("!document.getElementById('empty').hidden")
    found = {"said": page.page.inner_text("#empty")}
    page.shot("empty")
    page.page.set_input_files("#upload", {"name": "notes.zip", "mimeType": "application/zip", "buffer": b"no zip"})
    page.wait("document.getElementById('notice').classList.contains('error')")
    found["refused"] = page.page.inner_text("#notice")
    found["still"] = page.page.locator("#empty").is_visible()
    found["problems"] = page.problems
    page.context.close()
    server.kill()
    return found


def nameless(page):
    """Controls without a name in Chromium's own accessibility tree, and how many it has."""
    client = page.context.new_cdp_session(page.page)
    nodes = client.send("Accessibility.getFullAXTree")["nodes"]
    used = [node for node in nodes if not node.get("ignored") and node.get("role", {}).get("value") in USED]
    without = [node["role"]["value"] for node in used if not node.get("name", {}).get("value", "").strip()]
    return {"controls": len(used), "without": without}


def tools(browser, server):
    """Crops by a handle and a key, measures between two clicks, plays slices, finds a preset by words."""
    page = Window(browser, server, "/#preset=bone&az=0&el=0&zoom=1")
    settled(page)
    found = {"bounds": server.volumes[0]["bounds_mm"]}
    page.page.click("#crop-group summary")
    handle = page.page.get_by_role("button", name="Crop, head").bounding_box()
    middle = [handle["x"] + handle["width"] / 2, handle["y"] + handle["height"] / 2]
    page.page.mouse.move(*middle)
    page.page.mouse.down()
    page.page.mouse.move(middle[0], middle[1] + 60, steps=5)
    page.page.mouse.up()
    settled(page)
    found["dragged"] = kept(page).get("crop")
    handle = page.page.get_by_role("button", name="Crop, head").bounding_box()
    found["moved"] = handle["y"] + handle["height"] / 2 - middle[1]
    page.page.get_by_role("button", name="Crop, left").press("ArrowLeft")
    settled(page)
    found["pressed"] = kept(page).get("crop")
    page.page.check("#table")
    found["table"] = kept(page).get("table")
    page.shot("crop")
    page.page.click("#crop-reset")
    settled(page)
    found["whole"] = kept(page).get("crop")
    stage = page.page.locator("#stage").bounding_box()
    places = []
    for share, keys in [(0.45, []), (0.55, ["Shift"])]:
        page.page.locator("#stage").click(position={"x": stage["width"] / 2, "y": stage["height"] * share}, modifiers=keys)
        page.wait("document.getElementById('picked').innerText.includes('LPS')" + (" && document.getElementById('picked').innerText.includes('Distance')" if keys else ""))
        places.append(page.page.inner_text("#picked"))
    found["places"] = places
    page.page.get_by_role("button", name="Cut facing the viewer").click()
    settled(page)
    found["plane"] = kept(page).get("planes")
    page.shot("cut")
    found["removable"] = page.page.evaluate("document.querySelector('.crop-plane button').getBoundingClientRect().right - document.getElementById('panel').getBoundingClientRect().right")
    page.page.locator("#stage").click(position={"x": stage["width"] / 2, "y": stage["height"] * 0.45})
    page.wait(f"document.getElementById('picked').innerText.includes('LPS') && document.getElementById('picked').innerText !== {json.dumps(places[1])}")
    found["behind"] = page.page.inner_text("#picked")
    page.page.get_by_role("slider", name="Plane 1").press("ArrowRight")
    settled(page)
    found["plane_moved"] = kept(page).get("planes")
    page.page.get_by_role("button", name="Remove plane 1").click()
    settled(page)
    found["no_plane"] = kept(page).get("planes")
    page.page.fill("#preset-search", "contrast VESSELS")
    page.page.press("#preset-search", "Enter")
    settled(page)
    found["preset"] = kept(page).get("preset")
    page.page.fill("#preset-search", "no such words")
    found["none"] = page.page.is_visible("#no-preset")
    page.page.fill("#preset-search", "")
    page.page.check('input[name="plane"][value="axial"]', force=True)
    settled(page)
    number = "Number(document.getElementById('pose').innerText.match(/(\\d+)\\//)[1])"
    before = page.page.evaluate(number)
    page.page.locator("#stage").focus()
    page.key("c")
    page.wait(f"{number} >= {before} + 3", 60)
    found["playing"] = page.page.get_attribute("#cine", "aria-pressed")
    page.key("c")
    found["stopped"] = page.page.get_attribute("#cine", "aria-pressed")
    found["problems"] = page.problems
    page.context.close()
    return found


def looks(browser, server):
    """All pages on a desk and on a phone: nothing reaches out of the window, and every control has a name."""
    found = {}
    for size, pixels in SIZES.items():
        for name, path in ADDRESSES.items():
            page = Page(browser, server, "Ada Berg", pixels) if name == "annotate" else Window(browser, server, path, pixels)
            if name == "volume":
                settled(page)
            page.page.wait_for_timeout(1500)
            if name == "kiosk":
                page.shot(f"{size}-{name}-frame")
                page.key("m")
            page.shot(f"{size}-{name}")
            wide = page.page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
            outside = page.page.evaluate(OUTSIDE)
            found[f"{size} {name}"] = {**nameless(page), "wide": wide, "outside": outside, "problems": page.problems}
            found[f"{size} {name}"]["axe"] = accessibility(page)
            if name in ("volume", "annotate"):
                page.page.click("#help-button")
                page.page.wait_for_timeout(200)
                page.shot(f"{size}-{name}-help")
                help_box = page.page.locator("dialog[open]").bounding_box()
                found[f"{size} {name}"]["help"] = [help_box["x"], help_box["x"] + help_box["width"], help_box["y"], help_box["y"] + help_box["height"]]
            page.context.close()
    return found


def menus(browser):
    """Two volumes: both pages list them with pictures, and choosing one displays it."""
    other = pathlib.Path(FOLDER) / "slab"
    subprocess.run([RELIEF, "phantom", "--kind", "slab", "--size", "48", "--out", str(other)], check=True, stdout=subprocess.DEVNULL)
    server = Server(RELIEF, SERIES, "--series", str(other), "--annotations", str(pathlib.Path(FOLDER) / "menus.db"))
    loaded = "document.querySelectorAll('.volumes img.there').length === 2"
    found = {}
    try:
        while len(server.get("/v1/volumes")["volumes"]) < 2:
            time.sleep(0.1)
        page = Window(browser, server, "/")
        settled(page)
        page.wait(loaded, 60)
        found["names"] = page.page.locator("#volumes label").all_inner_texts()
        found["first"] = page.page.inner_text("#volume-facts")
        page.page.locator("#volumes input:not(:checked)").check(force=True)
        page.wait(f"document.getElementById('volume-facts').innerText !== {json.dumps(found['first'])}")
        found["second"] = page.page.inner_text("#volume-facts")
        settled(page)
        page.shot("menu")
        found["problems"] = page.problems
        page.context.close()
        page = Page(browser, server, "Ada Berg")
        page.page.click("#volume-menu summary")
        page.wait(loaded, 60)
        page.shot("menu-annotate")
        found["axe"] = accessibility(page)
        found["before"] = page.page.inner_text("#volume-menu summary")
        page.page.locator("#volumes input:not(:checked)").check(force=True)
        page.wait(f"document.querySelector('#volume-menu summary').innerText !== {json.dumps(found['before'])}")
        found["closed"] = page.page.locator("#volumes").is_hidden()
        found["problems"] += page.problems
        page.context.close()
    finally:
        server.kill()
    return found


def main():
    steps = sys.argv[5].split(",") if len(sys.argv) > 5 else []
    wanted = lambda step: not steps or step in steps
    server = Server(RELIEF, SERIES, "--annotations", str(pathlib.Path(FOLDER) / "views.db"))
    try:
        with sync_playwright() as playwright:
            browser = launched(playwright, CHROMIUM)
            found = {}
            for name, step in [("address", address), ("difference", difference), ("hands", hands), ("tools", tools), ("looks", looks)]:
                if wanted(name):
                    found[name] = step(browser, server)
            if wanted("menus"):
                found["menus"] = menus(browser)
            if wanted("empty"):
                found["empty"] = empty(browser)
        print(json.dumps(found))
    finally:
        server.kill()


main()
