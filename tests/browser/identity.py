"""Signs in to a server with tokens in Chromium, and prints its findings as one JSON object.

usage: identity.py RELIEF CHROMIUM SERIES FOLDER

RELIEF serves SERIES to holders of a token; FOLDER is for the files of the server. RELIEF_SHOTS names a folder for pictures.
"""

import json
import os
import subprocess
import sys
import time
import urllib.parse

from playwright.sync_api import sync_playwright

from pages import launched

RELIEF, CHROMIUM, SERIES, FOLDER = sys.argv[1:5]
SHOTS = os.environ.get("RELIEF_SHOTS")


def token(name, scope):
    command = [RELIEF, "token", "add", f"{FOLDER}/tokens", "--name", name, "--scope", scope]
    return subprocess.run(command, capture_output=True, check=True, text=True).stdout.strip()


def serve():
    command = [RELIEF, "serve", "--series", SERIES, "--listen", "127.0.0.1:0", "--listen-when-loaded"]
    command += ["--token-file", f"{FOLDER}/tokens", "--annotations", f"{FOLDER}/log.db"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    return process, process.stdout.readline().split()[-1].rstrip("/")


def until(condition):
    """Whether a condition becomes true within a minute. The pages allow no script that would wait in them."""
    for _ in range(600):
        if condition():
            return True
        time.sleep(0.1)
    return False


def main():
    anna, seen = token("anna", "annotate"), {}
    process, url = serve()
    try:
        with sync_playwright() as playwright:
            browser = launched(playwright, CHROMIUM)
            page = browser.new_page(viewport={"width": 1280, "height": 800})
            failures = []
            page.on("pageerror", lambda error: failures.append(str(error)))

            # Any page leads to the sign-in page, and back when the token is right.
            page.goto(f"{url}/annotate")
            seen["led_to"] = page.url.removeprefix(url)
            page.fill("#token", "relief_wrong")
            page.click("button[type=submit]")
            page.wait_for_selector("#problem:not([hidden])")
            seen["wrong_token"] = page.inner_text("#problem")
            page.fill("#token", "")
            if SHOTS:
                page.reload()
                page.screenshot(path=f"{SHOTS}/sign-in.png", clip={"x": 320, "y": 200, "width": 640, "height": 400})
            page.fill("#token", anna)
            page.click("button[type=submit]")
            page.wait_for_selector("#live[data-state=live]", timeout=60_000)
            seen["back_at"] = page.url.removeprefix(url).split("#")[0]
            seen["author"] = page.inner_text("#author")
            seen["sign_out"] = page.get_attribute("#identity", "title")
            seen["cookie_is_hidden"] = page.evaluate("document.cookie") == ""

            # A live session of the kiosk opens by a ticket.
            page.goto(f"{url}/kiosk")
            seen["kiosk"] = until(lambda: page.evaluate("(document.querySelector('canvas')?.width ?? 0) > 300"))

            # The viewer shows its picture, and signs out.
            page.goto(url)
            seen["picture"] = until(lambda: "connecting" not in page.inner_text("footer, .status"))
            if SHOTS:
                page.screenshot(path=f"{SHOTS}/signed-in.png")
            page.click("#identity")
            page.wait_for_url("**/sign-in**")
            page.goto(url)
            seen["after"] = page.url.removeprefix(url)

            # Links to the sign-in page lead to this server only.
            seen["elsewhere"] = []
            for path in ["/.//elsewhere.invalid/a", "/..//elsewhere.invalid/b", "//elsewhere.invalid/c", "\\\\elsewhere.invalid/d", "/./\\elsewhere.invalid/e",
                         "https://elsewhere.invalid/f", "javascript:document.title='run'"]:
                page.goto(f"{url}/sign-in?next={urllib.parse.quote(path)}")
                page.fill("#token", anna)
                with page.expect_navigation(url=lambda found: "/sign-in" not in found):
                    page.click("button[type=submit]")
                seen["elsewhere"].append(page.url.removeprefix(url).split("#")[0])
            seen["failures"] = failures
            browser.close()
    finally:
        process.terminate()
        process.wait(20)
    print(json.dumps(seen))


main()
