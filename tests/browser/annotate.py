"""Drives the page for annotations in Chromium, and prints its findings as one JSON object.

usage: annotate.py RELIEF CHROMIUM SERIES FOLDER

RELIEF serves SERIES and keeps annotations in FOLDER.
"""

import json
import pathlib
import sys
import time

from pages import Page, Server, launched
from playwright.sync_api import sync_playwright

RELIEF, CHROMIUM, SERIES, FOLDER = sys.argv[1:5]
FOLDER = pathlib.Path(FOLDER)
TEMPLATE = {
    "name": "face",
    "items": [
        {"name": "Nasion", "description": "Where the nasal bones meet the forehead."},
        {"name": "Left orbitale"},
        {"name": "Vertex", "description": "The highest point."},
    ],
}


def placing(page, server):
    """Points by clicks in 3D and in a slice, a line, broken off, undone and made again."""
    found = {}
    page.key("p")
    picked = page.pick("volume", 0.5, 0.42)
    page.click("volume", 0.5, 0.42)
    found["volume"] = {"placed": server.item("Point 1")["item"], "picked": picked}
    page.still()
    page.page.mouse.move(*page.at("axial", 0.9, 0.9))
    mark = "document.querySelector('.pane-volume .overlay g circle.ring')"
    page.wait(f"{mark} !== null")
    middle = f"(() => {{ const box = {mark}.getBoundingClientRect(); return [box.x + box.width / 2, box.y + box.height / 2]; }})()"
    found["volume"]["marked"] = page.page.evaluate(middle)
    found["volume"]["clicked"] = [side + 0.5 for side in page.at("volume", 0.5, 0.42)]
    picked = page.pick("axial", 0.4, 0.7)
    page.click("axial", 0.4, 0.7)
    found["axial"] = {"placed": server.item("Point 2")["item"], "picked": picked}
    page.still()
    found["cursor"] = page.page.get_attribute("#readout", "data-mm")
    page.wait("document.getElementById('readout').dataset.hu !== ''")
    found["value"] = {"shown": float(page.page.get_attribute("#readout", "data-hu")), "asked": page.value("axial", 0.4, 0.7)}
    page.key("l")
    ends = [page.pick("coronal", *at) for at in [(0.3, 0.35), (0.7, 0.6)]]
    page.click("coronal", 0.3, 0.35)
    page.click("coronal", 0.7, 0.6)
    found["line"] = {"placed": server.item("Line 1"), "picked": ends}
    page.wait_row("Line 1")
    found["rows"] = page.rows()
    page.page.mouse.move(*page.at("sagittal", 0.4, 0.4))
    page.page.mouse.down()
    page.page.mouse.move(*page.at("sagittal", 0.5, 0.5))
    page.key("Escape")
    page.page.mouse.up()
    page.wait("document.body.dataset.tool !== 'x'")
    found["after_escape"] = len(server.annotations()["items"])
    page.shot("placed")
    return found


def logged(server, action):
    """Does something that changes annotations, and waits until the server has the change: for 10 s at most."""
    before = server.annotations()["seq"]
    action()
    for _ in range(200):
        if server.annotations()["seq"] > before:
            return
        time.sleep(0.05)


def undoing(page, server):
    counts = [len(server.annotations()["items"])]
    for keys in ["Control+z", "Control+z", "Control+Shift+z", "Control+Shift+z"]:
        logged(server, lambda: page.key(keys))
        counts.append(len(server.annotations()["items"]))
    page.wait_row("Line 1")
    page.key("g")
    page.wait("document.querySelectorAll('#log li').length > 4")
    found = {"counts": counts, "log": page.page.eval_on_selector_all("#log li", "(rows) => rows.map((row) => row.innerText)")}
    page.shot("log")
    page.key("g")
    return found


def editing(page, server):
    """By grabbing: a free point follows, a locked one does not."""
    page.key("v")
    before = server.item("Point 2")["item"]["geometry"]["at_mm"]

    def choose():
        """Chooses the point, and waits until the axial slice goes through it."""
        page.page.click('.item[data-name="Point 2"] .item-main')
        for _ in range(600):
            if abs(float(page.asked["axial"]["center_mm"].split(",")[2]) - before[2]) < 0.01:
                page.still()
                return
            page.page.wait_for_timeout(50)
        raise SystemExit("the axial slice does not go through the chosen point")

    choose()
    sight = page.asked["axial"]
    box = page.box("axial")
    per_pixel = float(sight["height_mm"]) / box["height"]
    center = [float(value) for value in sight["center_mm"].split(",")]
    # The axial picture has the patient's left at its right, and the back at its bottom.
    at = [box["x"] + box["width"] / 2 + (before[0] - center[0]) / per_pixel, box["y"] + box["height"] / 2 + (before[1] - center[1]) / per_pixel]
    found = {"before": before, "per_pixel": per_pixel}

    def drag(dx, dy, grabs=False):
        start = [round(at[0]), round(at[1])]
        page.page.mouse.move(*start)
        if grabs:
            page.wait("document.querySelector('.pane-axial').classList.contains('grabs')")
        page.page.mouse.down()
        for step in range(1, 6):
            page.page.mouse.move(start[0] + dx * step / 5, start[1] + dy * step / 5)
            page.page.wait_for_timeout(20)
        page.page.mouse.up()

    drag(40, 0)
    page.page.wait_for_timeout(400)
    found["not_in_look"] = server.item("Point 2")["item"]["geometry"]["at_mm"]
    choose()
    page.key("e")
    logged(server, lambda: drag(40, -20, grabs=True))
    found["after"] = server.item("Point 2")["item"]["geometry"]["at_mm"]
    page.page.wait_for_timeout(400)
    logged(server, lambda: page.key("Control+z"))
    page.page.wait_for_timeout(400)
    logged(server, lambda: page.key("k"))
    page.page.wait_for_timeout(400)
    choose()
    drag(40, 0)
    page.wait("document.getElementById('notice').innerText.includes('is locked')")
    found["locked"] = server.item("Point 2")["item"]
    found["said"] = page.page.inner_text("#notice")
    page.page.locator("#items").focus()
    logged(server, lambda: page.key("k"))
    page.page.wait_for_timeout(400)
    page.key("v")
    return found


def keyboard(page, server):
    """A point without a pointer: the view, the cursor, the tool, Enter; and one that snaps, with its displacement."""
    page.page.locator("#items").click(position={"x": 5, "y": 300})
    page.key("2")
    before = [float(mm) for mm in page.page.get_attribute("#readout", "data-mm").split(",")]
    for key in ["ArrowRight", "ArrowRight", "ArrowUp", "PageUp"]:
        page.key(key)
    page.page.wait_for_timeout(300)
    cursor = [float(mm) for mm in page.page.get_attribute("#readout", "data-mm").split(",")]
    page.key("p")
    page.key("Enter")
    placed = server.item("Point 3")["item"]
    found = {"before": before, "cursor": cursor, "placed": placed, "focus": page.page.evaluate("document.activeElement.dataset.pane")}
    page.wait_row("Point 3")
    page.page.select_option("#snap-to", "gradient")
    page.still()
    page.click("coronal", 0.33, 0.3)
    found["snapped"] = server.item("Point 4")["item"]
    page.wait("document.getElementById('brief').innerText.includes('snapped')")
    found["said"] = page.page.inner_text("#brief")
    page.page.select_option("#snap-to", "off")
    page.key("Escape")
    for _ in range(2):
        page.key("Control+z")
        page.page.wait_for_timeout(400)
    found["left"] = len(server.annotations()["items"])
    return found


def template(page, server):
    """Guided placement with one that is skipped, and come back to."""
    path = FOLDER / "face.json"
    path.write_text(json.dumps(TEMPLATE), encoding="utf-8")
    page.page.click("#templates-button")
    with page.page.expect_file_chooser() as chooser:
        page.page.click("#dialog button[value=file]")
    chooser.value.set_files(path)
    guide = "document.getElementById('guide').dataset"
    page.wait(f"{guide}.expected === 'Nasion'")
    seen = lambda: page.page.evaluate(f"({{ ...{guide} }})")
    found = {"begin": seen()}
    page.still()
    page.click("volume", 0.48, 0.4)
    page.wait(f"{guide}.expected === 'Left orbitale'")
    page.key("s")
    page.wait(f"{guide}.expected === 'Vertex'")
    found["skipped"] = seen()
    page.shot("template")
    page.click("coronal", 0.5, 0.2)
    page.wait(f"{guide}.placed === '2'")
    found["decided"] = seen()
    page.still()
    page.page.click("#guide details summary")
    page.page.click("#guide li button.skipped")
    page.wait(f"{guide}.expected === 'Left orbitale'")
    page.click("volume", 0.6, 0.45)
    page.wait(f"{guide}.placed === '3'")
    found["complete"] = seen()
    listed = server.annotations()
    found["states"] = [entry["item"]["state"] for entry in listed["items"] if entry["item"].get("list") == "face"]
    found["server"] = listed.get("complete")
    page.page.click("#guide .side-head button")
    page.key("v")
    return found


def conflict(browser, page, server):
    """Two pages change the same item: nothing is overwritten before a user decides."""
    other = Page(browser, server, "Ben Ode")
    other.wait_row("Line 1")
    page.page.click('.item[data-name="Line 1"] .item-main')
    page.still()
    # While one renames, the other does too, and is later.
    page.page.dblclick('.item[data-name="Line 1"] .item-name')
    page.page.fill(".item-rename", "Orbit width")
    other.page.dblclick('.item[data-name="Line 1"] .item-name')
    other.page.fill(".item-rename", "Bizygomatic")
    other.key("Enter")
    other.wait_row("Bizygomatic")
    page.key("Enter")
    page.wait("document.getElementById('dialog').open")
    found = {"shown": page.page.inner_text("#dialog")}
    page.shot("conflict")
    names = [entry["item"]["name"] for entry in server.annotations()["items"]]
    found["before_decision"] = [name for name in names if name in ("Orbit width", "Bizygomatic")]
    page.page.keyboard.press("Enter")  # the dialog proposes the own version
    server.item("Orbit width")
    page.wait_row("Orbit width")
    other.wait_row("Orbit width")
    found["other"] = [row for row in other.rows() if "Orbit width" in row]
    other.wait("document.getElementById('live').dataset.state !== 'asking'")
    found["live"] = other.page.get_attribute("#live", "data-state")
    found["problems"] = other.problems
    other.context.close()
    return found


def files(page, server):
    """Out as mrk.json, deleted, and in again."""
    page.key("v")
    path = FOLDER / "out.mrk.json"
    downloads = []
    page.page.on("download", lambda download: downloads.append(download))

    def export():
        page.page.dblclick("#export-button")  # opens one dialog, and saves one file
        page.wait("document.getElementById('dialog').open")  # until then it has the last export's form, which is checked already
        page.page.check('#dialog input[value="mrk.json"]')
        with page.page.expect_download() as download:
            # Confirms, wherever the button stands. The focus may still be elsewhere on a busy machine.
            page.page.press('#dialog input[value="mrk.json"]', "Enter")
        download.value.save_as(path)
        return download.value.suggested_filename

    found = {"name": export(), "file": json.loads(path.read_text(encoding="utf-8"))}
    found["dialogs"] = [page.page.evaluate("document.getElementById('dialog').open"), len(downloads)]
    before = {entry["item"]["name"]: entry["item"]["geometry"] for entry in server.annotations()["items"]}
    for name in ["Point 1", "Point 2"]:
        page.page.click(f'.item[data-name="{name}"] .item-main')
        page.page.click(f'.item[data-name="{name}"] button[aria-label="Delete {name}"]')
        page.wait(f"!document.querySelector('.item[data-name=\"{name}\"]')")
    found["deleted"] = [entry["item"]["name"] for entry in server.annotations()["items"]]
    page.page.set_input_files("#import", path)
    page.wait_row("Point 1")
    after = [(entry["item"]["name"], entry["item"]["geometry"]) for entry in server.annotations()["items"]]
    found["points"] = [[before[name], geometry] for name, geometry in after if name in ("Point 1", "Point 2")]
    found["updated"] = changed_file(page, server, path, export)
    bad = FOLDER / "bad.mrk.json"
    bad.write_text('{"markups": 3}', encoding="utf-8")
    count = len(after)
    page.page.set_input_files("#import", bad)
    page.wait("document.getElementById('notice').classList.contains('error')")
    found["bad"] = {"said": page.page.inner_text("#notice"), "items": [count, len(server.annotations()["items"])]}
    return found


def changed_file(page, server, path, export):
    """A file whose point was moved: skipped, then updated, as the dialog is answered."""
    export()
    file = json.loads(path.read_text(encoding="utf-8"))
    for markups in file["markups"]:
        for point in markups["controlPoints"]:
            if point["label"] == "Point 1":
                point["position"][2] += 3
    path.write_text(json.dumps(file), encoding="utf-8")
    place = lambda: next(e["item"]["geometry"]["at_mm"] for e in server.annotations()["items"] if e["item"]["name"] == "Point 1")
    places, count = [place()], len(server.annotations()["items"])
    for button in ["skip", "update"]:
        page.page.set_input_files("#import", path)
        page.page.locator(f'#dialog button[value="{button}"]').click()
        page.wait("!document.getElementById('dialog').open")
        page.page.wait_for_timeout(600)
        places.append(place())
    return {"places": places, "items": [count, len(server.annotations()["items"])]}


def drawn(page):
    """How many pixels of regions and meshes each pane shows."""
    page.page.wait_for_timeout(400)
    return page.page.evaluate(
        "Object.fromEntries([...document.querySelectorAll('.pane')].map((pane) => { const layer = pane.querySelector('.layer');"
        " const { data } = layer.getContext('2d').getImageData(0, 0, layer.width, layer.height);"
        " let count = 0; for (let i = 3; i < data.length; i += 4) count += data[i] > 0; return [pane.dataset.pane, count]; }))"
    )


def growing(page, server):
    """A region from a seed in bone, with its volume before and after."""
    page.page.click('.item[data-name="Point 1"] .item-main')
    page.still()
    page.key("r")
    page.page.fill("#grow-low", "400")
    page.page.fill("#grow-high", "3000")
    page.page.fill("#grow-ml", "2000")
    page.page.locator("#grow-ml").blur()
    page.click("volume", 0.475, 0.4)
    page.wait("!document.getElementById('grow-now').disabled")
    found = {"preview": page.page.inner_text("#grow-state"), "extent": drawn(page)}
    page.page.fill("#grow-high", "1400")  # the extent follows without a press
    page.wait(f"document.getElementById('grow-state').innerText !== {json.dumps(found['preview'])} && !document.getElementById('grow-now').disabled")
    found["narrower"] = [page.page.inner_text("#grow-state"), drawn(page)]
    page.page.fill("#grow-high", "3000")
    page.wait(f"document.getElementById('grow-state').innerText === {json.dumps(found['preview'])} && !document.getElementById('grow-now').disabled")
    page.page.click("#grow-now")
    region = server.item("Region 1")
    found["region"] = region
    page.wait_row("Region 1")
    page.page.click('.item[data-name="Region 1"] button[aria-label="Mesh of Region 1"]')
    found["mesh"] = server.item("Region 1 mesh")
    page.wait_row("Region 1 mesh")
    page.page.wait_for_timeout(1500)
    found["drawn"] = drawn(page)
    page.shot("grown")
    page.page.fill("#grow-ml", "1")
    page.page.locator("#grow-ml").blur()
    page.click("volume", 0.475, 0.4)
    page.wait("document.getElementById('grow-state').innerText.includes('leak')")
    found["leak"] = page.page.inner_text("#grow-state")
    page.key("Escape")
    page.key("v")
    return found


def without(browser):
    """A server without annotations: looking works, and the page says how to start it with them."""
    server = Server(RELIEF, SERIES)
    page = Page(browser, server, "Ada Berg")
    page.wait("!document.getElementById('off').hidden")
    found = {"said": page.page.inner_text("#off")}
    page.click("axial", 0.4, 0.4)
    page.still()
    found["cursor"] = page.page.get_attribute("#readout", "data-mm")
    page.shot("off")
    server.kill()
    return found


def main():
    steps = sys.argv[5].split(",") if len(sys.argv) > 5 else []
    wanted = lambda step: not steps or step in steps
    server = Server(RELIEF, SERIES, "--annotations", str(FOLDER / "annotations.db"))
    try:
        with sync_playwright() as playwright:
            browser = launched(playwright, CHROMIUM)
            page = Page(browser, server, "Ada Berg")
            found = {"placing": placing(page, server)}
            for name, step in [("undoing", undoing), ("editing", editing), ("keyboard", keyboard), ("template", template), ("files", files), ("growing", growing)]:
                if wanted(name):
                    found[name] = step(page, server)
                if name == "template" and wanted("conflict"):
                    found["conflict"] = conflict(browser, page, server)
            found["problems"] = page.problems
            if wanted("without"):
                found["without"] = without(browser)
        print(json.dumps(found))
    finally:
        server.kill()


main()
