"""Drives several readers of the page for annotations: blinded sets, two windows at once, files that are dropped; prints one JSON object.

usage: readers.py RELIEF CHROMIUM SERIES FOLDER

RELIEF serves SERIES and keeps annotations in FOLDER.
"""

import json
import pathlib
import sys
import time

from pages import Page, Server, launched
from playwright.sync_api import sync_playwright

RELIEF, CHROMIUM, SERIES, FOLDER = sys.argv[1:5]
READERS = {"cara": "Cara Lind", "dan": "Dan Moe"}


def names(server, author):
    return sorted(entry["item"]["name"] for entry in server.annotations(author)["items"])


def seen(page):
    """Names in the list, and marks that are drawn in the axial view."""
    return {
        "rows": sorted(page.page.evaluate("[...document.querySelectorAll('.item')].map((row) => row.dataset.name)")),
        "marks": page.page.evaluate("document.querySelectorAll('.pane-axial .overlay .ring').length"),
    }


def tabs(browser, server):
    """Two windows of two people: what one does the other sees, without asking for anything."""
    one, two = Page(browser, server, "Ada Berg"), Page(browser, server, "Ben Ode")
    for page in (one, two):
        page.wait("document.getElementById('live').dataset.state === 'live'")
    found = {}
    one.key("p")
    one.click("axial", 0.45, 0.5)
    server.item("Point 1")
    since = time.monotonic()
    two.wait_row("Point 1")
    found["seconds"] = time.monotonic() - since
    two.wait("document.querySelectorAll('.pane-axial .overlay .ring').length === 1")
    found["placed"] = seen(two)
    two.page.dblclick('.item[data-name="Point 1"] .item-name')
    two.page.fill(".item-rename", "Sella")
    two.key("Enter")
    one.wait_row("Sella")
    found["renamed"] = seen(one)
    one.page.locator("#items").focus()
    one.key("Control+z")
    # Another user changed it since: it is not undone, and both pages report it.
    one.wait("!document.getElementById('notice').hidden")
    found["not_undone"] = one.page.inner_text("#notice")
    two.key("Control+z")
    one.wait_row("Point 1")
    one.page.locator("#items").focus()
    one.key("Control+z")
    two.wait("document.querySelectorAll('.item').length === 0")
    found["gone"] = seen(two)
    found["problems"] = one.problems + two.problems
    for page in (one, two):
        page.context.close()
    return found


def blinded(browser, server):
    """Two readers who may not see each other's items."""
    found = {}
    pages = {}
    for number, (name, author) in enumerate(READERS.items()):
        page = pages[name] = Page(browser, server, author)
        page.page.select_option("#set", "")
        page.page.fill('#dialog input[name="name"]', name)
        page.page.check('#dialog input[name="blinded"]')
        page.shot("new-set")
        page.page.click("#dialog button[value=ok]")
        page.wait(f"document.getElementById('set').value === {json.dumps(name)}")
        page.key("p")
        page.still()
        page.click("axial", 0.4 + 0.1 * number, 0.5)
        page.wait("document.querySelectorAll('.item').length === 1")
        page.still()
    # All pages have been notified by now.
    for name, page in pages.items():
        page.page.wait_for_timeout(500)
        found[name] = {
            **seen(page), "sets": page.page.evaluate("[...document.getElementById('set').options].map((option) => option.text)"),
            "asked": [entry["item"]["set"] for entry in server.annotations(READERS[name])["items"]],
            "log": page.page.evaluate("fetch(`/v1/volumes/${location.hash.split('volume=')[1]}/annotations/log?after=0&limit=99`,"
                                      f" {{ headers: {{ 'Relief-Author': '{READERS[name]}' }} }}).then((answer) => answer.text())"),
        }
        found[name]["problems"] = page.problems
    found["anybody"] = names(server, "Eve Roe")
    for page in pages.values():
        page.context.close()
    return found


def drop(page, name, text):
    """Drops a file on the page, as a hand does."""
    carried = page.page.evaluate_handle(
        "([name, text]) => { const carried = new DataTransfer(); carried.items.add(new File([text], name)); return carried; }", [name, text])
    page.page.dispatch_event("#panes", "dragover", {"dataTransfer": carried})
    reported = page.page.evaluate("document.body.classList.contains('dropping')")
    page.page.dispatch_event("#panes", "drop", {"dataTransfer": carried})
    return reported


def dropping(browser, server):
    """A file that is good, ones that are not: taken whole, or refused with words and nothing changed."""
    page = Page(browser, server, "Fay Wynn")
    markups = {
        "@schema": "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/markups-schema-v1.0.3.json#",
        "markups": [{
            "type": "Fiducial", "coordinateSystem": "RAS", "coordinateUnits": "mm",
            "controlPoints": [{"id": "1", "label": "Tragus", "position": [12.5, -3.25, 20.75], "positionStatus": "defined"}],
        }],
    }
    found = {"over": drop(page, "ears.mrk.json", json.dumps(markups))}
    page.wait_row("Tragus")
    found["taken"] = server.item("Tragus")["item"]
    found["said"] = page.page.inner_text("#notice")
    found["cursor"] = page.page.get_attribute("#readout", "data-mm")
    before = server.annotations("Fay Wynn")["seq"]
    found["bad"] = {}
    for name, text in [("bad.mrk.json", '{"markups": 3}'), ("half.mrk.json", json.dumps(markups)[:-40]), ("letter.txt", "Dear colleague,"), ("empty.csv", "")]:
        page.page.evaluate("document.getElementById('notice').hidden = true")
        drop(page, name, text)
        page.wait("!document.getElementById('notice').hidden && document.getElementById('notice').classList.contains('error')")
        found["bad"][name] = page.page.inner_text("#notice")
    page.shot("dropped")
    found["changed"] = server.annotations("Fay Wynn")["seq"] - before
    found["rows"] = seen(page)["rows"]
    found["problems"] = page.problems
    page.context.close()
    return found


def main():
    server = Server(RELIEF, SERIES, "--annotations", str(pathlib.Path(FOLDER) / "readers.db"))
    try:
        with sync_playwright() as playwright:
            browser = launched(playwright, CHROMIUM)
            found = {"tabs": tabs(browser, server), "dropping": dropping(browser, server), "blinded": blinded(browser, server)}
        print(json.dumps(found))
    finally:
        server.kill()


main()
