"""The phases of a series on the page and in the kiosk, cut faces, and the name on pictures.

usage: phases.py RELIEF CHROMIUM SERIES FOLDER

Three phases are made of SERIES in FOLDER, with rising values.
"""

import json
import pathlib
import sys

import pydicom
from pages import Server, Window, launched, settled
from playwright.sync_api import sync_playwright

RELIEF, CHROMIUM, SERIES, FOLDER = sys.argv[1:5]
COUNT = 3
NAME = "document.getElementById('series').innerText"


def moving():
    """A folder with the phases."""
    folder = pathlib.Path(FOLDER) / "moving"
    folder.mkdir()
    for path in sorted(pathlib.Path(SERIES).rglob("*.dcm")):
        for phase in range(1, COUNT + 1):
            one = pydicom.dcmread(path)
            one.TemporalPositionIdentifier = phase
            one.RescaleIntercept = float(one.RescaleIntercept) + 40 * phase
            one.SOPInstanceUID = one.file_meta.MediaStorageSOPInstanceUID = f"{one.SOPInstanceUID}.{phase}"
            one.save_as(folder / f"{phase}-{path.name}")
    return str(folder)


def page(browser, server):
    window = Window(browser, server, "/")
    settled(window)
    found = {"visible": window.page.is_visible("#phases"), "first": window.page.evaluate(NAME)}
    pose = "location.hash.match(/az=[^&]*&el=[^&]*&zoom=[^&]*/)[0]"
    for _ in range(5):
        window.key("ArrowLeft")
    settled(window)
    before = window.page.evaluate(pose)
    window.page.focus("#phase")
    window.key("ArrowRight")
    window.wait(f"{NAME}.includes('phase 2 of 3')")
    settled(window)
    found["slider"] = [window.page.inner_text("#phase-value"), window.page.evaluate(pose) == before]
    window.shot("phases")
    seen = set()
    window.page.click("#phases-play")
    for _ in range(3000):
        seen.add(window.page.inner_text("#phase-value"))
        if len(seen) == COUNT:
            break
        window.page.wait_for_timeout(20)
    found["playing"] = [sorted(seen), window.page.inner_text("#phases-play")]
    window.page.click("#phases-play")
    settled(window)
    found["stopped"] = [window.page.inner_text("#phases-play"), window.page.evaluate(pose) == before]
    # Cut faces and the name.
    window.page.evaluate("document.getElementById('crop-group').open = true")
    window.page.check("#cut-slice")
    window.page.evaluate("document.querySelector('input[value=caption]').click()")
    settled(window)
    found["asked"] = {key: window.asked["volume"].get(key) for key in ("cut", "overlay")}
    window.shot("cut")
    window.page.reload()
    settled(window)
    found["reloaded"] = [window.asked["volume"].get("cut"), window.page.is_checked("#cut-slice")]
    window.page.select_option("#mode", "mip")
    settled(window)
    found["mip"] = [window.asked["volume"].get("cut"), window.page.is_visible("#cut-slice-field")]
    found["problems"] = window.problems
    window.context.close()
    return found


def kiosk(browser, server):
    window = Window(browser, server, f"/kiosk?volume={server.volumes[0]['id']}&phase=2")
    window.wait("document.documentElement.dataset.still === 'true'", 60)
    found = {"title": window.page.title()}
    window.shot("kiosk-caption")
    window.key("c")
    seen = set()
    for _ in range(3000):
        seen.add(window.page.title())
        if len(seen) == COUNT:
            break
        window.page.wait_for_timeout(20)
    found["playing"] = sorted(seen)
    window.key("c")
    window.page.wait_for_timeout(2000)
    window.wait("document.documentElement.dataset.still === 'true'", 60)
    stopped = window.page.title()
    window.page.wait_for_timeout(500)
    found["stopped"] = window.page.title() == stopped
    found["problems"] = window.problems
    window.context.close()
    return found


def main():
    with sync_playwright() as playwright:
        browser = launched(playwright, CHROMIUM)
        server = Server(RELIEF, moving())
        try:
            found = {"volumes": [volume["name"] for volume in server.volumes], "page": page(browser, server), "kiosk": kiosk(browser, server)}
        finally:
            server.kill()
            browser.close()
    print(json.dumps(found))


main()
