"""Links to series that are missing, and servers that restart: no page shows another series, and none stays in a wrong state.

usage: safety.py RELIEF CHROMIUM SERIES FOLDER

RELIEF serves SERIES and a second one, and keeps annotations in FOLDER. RELIEF_RESTARTS is the number of restarts (3).
"""

import json
import os
import pathlib
import random
import subprocess
import sys
import time

from pages import Page, Server, Window, launched, settled
from playwright.sync_api import Error, sync_playwright

RELIEF, CHROMIUM, SERIES, FOLDER = sys.argv[1:5]
FOLDER = pathlib.Path(FOLDER)
RESTARTS = int(os.environ.get("RELIEF_RESTARTS", "3"))
ABSENT = "0123456789abcdef"
SHOWN = "!document.getElementById('missing').hidden"
TEXT = "(id) => document.getElementById(id).innerText"


def missing(browser, server, path, still):
    """A link to a series that is not there; then another one is chosen."""
    window = Window(browser, server, f"{path}#volume={ABSENT}&az=77&zoom=3")
    window.wait(SHOWN)
    window.page.wait_for_timeout(1500)
    found = {
        "said": window.page.evaluate(TEXT, "missing"),
        "name": window.page.evaluate(TEXT, "series"),
        "address": window.page.evaluate("location.hash"),
        "pictures": sorted(window.asked),
    }
    window.shot(f"missing{path.replace('/', '-')}")
    second = server.volumes[1]
    window.page.click(f"#missing button:has-text('{second['id'][:8]}')")
    window.wait("document.getElementById('missing').hidden")
    still(window)
    found["chosen"] = {
        "name": window.page.evaluate(TEXT, "series"),
        "address": window.page.evaluate("location.hash"),
        "expected": [second["name"], second["id"]],
    }
    window.shot(f"chosen{path.replace('/', '-')}")
    # Another link in the same window.
    first = server.volumes[0]
    window.page.evaluate(f"location.hash = 'volume={first['id']}'")
    for _ in range(600):
        try:
            if first["id"][:8] in window.page.evaluate(TEXT, "series"):
                break
        except Error:  # the page is being loaded
            pass
        window.page.wait_for_timeout(100)
    else:
        raise SystemExit("the second link shows nothing")
    found["problems"] = window.problems
    window.context.close()
    return found


def panes_still(window):
    window.wait("document.querySelectorAll('.pane[data-still=true]').length === 5", 60)


def has_volumes(server):
    try:
        return len(server.get("/v1/volumes")["volumes"]) == len(server.volumes)
    except OSError:
        return False


STATE = "[document.getElementById('live').dataset.state, document.body.dataset.annotations, document.getElementById('off').hidden]"


def recovered(number, server, pages, wrong):
    """Waits until every page follows the server again; notes states that are not true."""
    began, ready, waiting = time.monotonic(), False, list(pages)
    while waiting:
        ready = ready or has_volumes(server)
        for page in list(waiting):
            state = page.page.evaluate(STATE)
            if state[1:] != ["on", True]:
                wrong.append([number, state])
            if ready and state[0] in ("live", "asking"):
                waiting.remove(page)
        if time.monotonic() - began > 60:
            raise SystemExit(f"restart {number}: {state}")
        pages[0].page.wait_for_timeout(50)


def restarts(browsers, server):
    """The server is killed and started again at random moments while two people annotate in a browser each: every confirmed edit
    is kept, and the state is true. Edits that the server had not confirmed are there or not, and alike on both pages."""
    dice = random.Random(51)
    pages = [Page(browser, server, name) for browser, name in zip(browsers, ("Ada", "Ben"))]
    kept, wrong, problems = [], [], []
    for number in range(RESTARTS):
        confirmed = len(server.annotations()["items"])
        for place, page in enumerate(pages):
            page.key("p")
            page.click("axial", 0.3 + 0.01 * (number % 40), 0.3 + 0.4 * place)
        pages[0].page.wait_for_timeout(dice.choice([0, 1, 5, 20, 100]))
        server.kill()
        # Longer than the page's interval between questions, or shorter.
        pages[0].page.wait_for_timeout(dice.choice([0, 300, 2500]))
        server.start()
        recovered(number, server, pages, wrong)
        before = len(server.annotations()["items"])
        name = f"After {number}"
        server.add_points("Ada", **{name: [number, 0, 0]})
        for place, page in enumerate(pages):
            page.wait_row(name)
            page.key("p")
            page.click("axial", 0.3 + 0.01 * (number % 40), 0.4 + 0.2 * place)
        # The pages name their own points by their numbers.
        expected = before + 1 + len(pages)
        for _ in range(600):
            found = [len(server.annotations()["items"]), *(int(page.page.inner_text("#count")) for page in pages)]
            if found == [expected] * len(found):
                break
            time.sleep(0.05)
        kept.append(before >= confirmed and found == [expected] * len(found))
    lost = "ERR_CONNECTION_REFUSED", "WebSocket", "Failed to fetch", "404", "503", "ERR_CONNECTION_RESET", "ERR_EMPTY_RESPONSE", "ERR_SOCKET_NOT_CONNECTED"
    problems = [problem for page in pages for problem in page.problems if not any(word in problem for word in lost)]
    for page in pages:
        page.context.close()
    return {"restarts": RESTARTS, "kept": kept, "wrong": wrong, "problems": problems}


def main():
    second = FOLDER / "second"
    subprocess.run([RELIEF, "phantom", "--kind", "sphere", "--size", "32", "--out", str(second)], check=True, stdout=subprocess.DEVNULL)
    with sync_playwright() as playwright:
        browser, another = launched(playwright, CHROMIUM), launched(playwright, CHROMIUM)
        server = Server(RELIEF, SERIES, "--series", str(second), "--annotations", str(FOLDER / "a.db"))
        for _ in range(600):
            server.volumes = server.get("/v1/volumes")["volumes"]
            if len(server.volumes) == 2:
                break
            time.sleep(0.1)
        server.volume = f"/v1/volumes/{server.volumes[0]['id']}"
        try:
            found = {
                "page": missing(browser, server, "/", settled),
                "annotate": missing(browser, server, "/annotate", panes_still),
                "restarts": restarts([browser, another], server),
            }
        finally:
            server.kill()
            browser.close()
            another.close()
    print(json.dumps(found))


main()
