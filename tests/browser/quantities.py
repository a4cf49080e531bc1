"""A series whose values are no HU, on the page and on /annotate.

usage: quantities.py RELIEF CHROMIUM SERIES FOLDER

SERIES becomes a map of iodine (RescaleType MGML) in FOLDER.
"""

import json
import pathlib
import sys

import pydicom
from pages import Page, Server, Window, launched, settled
from playwright.sync_api import sync_playwright

RELIEF, CHROMIUM, SERIES, FOLDER = sys.argv[1:5]
CHOSEN = "[...document.querySelectorAll('input[name=preset]:checked')].length"


def iodine():
    """A folder with the series."""
    folder = pathlib.Path(FOLDER) / "iodine"
    folder.mkdir()
    for path in sorted(pathlib.Path(SERIES).rglob("*.dcm")):
        one = pydicom.dcmread(path)
        one.RescaleType = "MGML"
        one.save_as(folder / path.name)
    return str(folder)


def looks(window):
    """What the page says of the look, and what it asked for."""
    return [window.page.evaluate(CHOSEN), window.asked["volume"].get("preset"), window.page.inner_text("#purpose")]


def units(page):
    """The units beside the inputs of values."""
    return page.locator("[data-value-unit]").all_text_contents()


def page(browser, server):
    window = Window(browser, server, "/")
    settled(window)
    found = {"facts": window.page.inner_text("#volume-facts"), "first": looks(window)}
    window.shot("quantity")
    window.page.locator("input[name=preset]").first.check(force=True)
    settled(window)
    found["chosen"] = looks(window)[:2]
    window.page.reload()
    settled(window)
    found["reloaded"] = looks(window)[:2]
    found["units"] = units(window.page)
    found["problems"] = window.problems
    window.context.close()
    return found


def annotate(browser, server):
    page = Page(browser, server, "anna")
    page.still()
    found = {"facts": page.page.inner_text("#volume-facts"), "preset": page.page.input_value("#preset")}
    page.click("axial", 0.5, 0.5)
    page.wait("document.getElementById('readout').innerText.includes('MGML')")
    page.shot("quantity-annotate")
    found["units"] = units(page.page)
    found["problems"] = page.problems
    page.context.close()
    return found


def main():
    with sync_playwright() as playwright:
        browser = launched(playwright, CHROMIUM)
        server = Server(RELIEF, iodine(), "--annotations", str(pathlib.Path(FOLDER) / "iodine.db"))
        try:
            found = {"page": page(browser, server), "annotate": annotate(browser, server)}
        finally:
            server.kill()
            browser.close()
    print(json.dumps(found))


main()
