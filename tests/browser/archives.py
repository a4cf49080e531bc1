"""Finds a series in an archive on the page of the volume, loads it,
and stores a picture and a report there; prints what it saw as one JSON object.

usage: archives.py CHROMIUM URL      URL of a server with an archive and annotations, and without a series
"""

import json
import os
import sys

CHROMIUM, URL = sys.argv[1:3]
os.environ["RELIEF_PAGE_URL"] = URL

from pages import Server, Window, accessibility, launched, settled  # noqa: E402  (reads the address)
from playwright.sync_api import sync_playwright  # noqa: E402

server = Server(None, None)
seen = {}
with sync_playwright() as playwright:
    browser = launched(playwright, CHROMIUM)
    window = Window(browser, server, "/", size={"width": 1400, "height": 900})
    page = window.page
    window.wait("!document.getElementById('archives').hidden")
    page.click("#archives summary")

    def search(button=True):
        if button:
            page.click("#archive-search")
        else:
            page.press("#archive-patient_id", "Enter")
        window.wait("!document.getElementById('archive-found').textContent.startsWith('Searching')")
        return page.inner_text("#archive-found")

    seen["empty"] = search()
    page.fill("#archive-patient_id", "nobody")
    seen["none"] = search(button=False)
    page.fill("#archive-patient_id", "*")
    seen["found"] = search()
    seen["row"] = page.inner_text("#archive-series li")
    window.shot("archive-found")
    page.click("#archive-series button")
    settled(window)
    seen["shown"] = [page.evaluate("location.hash").split("volume=")[-1].split("&")[0]]
    window.shot("archive-loaded")
    seen["stored"] = []
    for said in ("Stored", "has this"):
        page.click("#sending button")
        window.wait(f"document.getElementById('notice').textContent.includes('{said}')")
        seen["stored"].append(page.inner_text("#notice"))
    window.shot("archive-stored")
    seen["violations"] = accessibility(window)["violations"]
    seen["problems"] = window.problems

    window = Window(browser, server, "/annotate", size={"width": 1400, "height": 900}, author="reader")
    page = window.page
    window.wait("document.querySelectorAll('#items .item').length > 0")
    for said in ("Stored", "has these"):
        page.click("#export-button")
        page.select_option("#dialog-to", "pacs")
        page.check("#dialog input[value=sr]")
        window.shot("archive-export")
        page.click("#dialog .primary")
        message = "['brief', 'notice'].map((id) => document.getElementById(id).textContent).join('')"
        window.wait(f"({message}).includes('{said}')", 5)
        seen["stored"].append(page.evaluate(message))
    seen["problems"] += window.problems
    browser.close()
print(json.dumps(seen))
