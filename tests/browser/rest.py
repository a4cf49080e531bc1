"""A picture at rest in the kiosk: views that the server has rendered for its eyes.

They are compared with those of `relief render --views true`, whose cameras the command line makes for itself.
"""

import io
import json
import os
import subprocess
import sys
import tempfile
import urllib.error
import urllib.request

import numpy
from PIL import Image

RELIEF, SERIES = sys.argv[1], sys.argv[3]
ROOT = "document.documentElement.dataset"
SIZE = (480, 270)
ADDRESS = f"/kiosk?caption=false&preset=bone&size={SIZE[0]}x{SIZE[1]}&view=rest"


def rendered(layout, *more):
    """The true views of the live view's first picture."""
    with tempfile.TemporaryDirectory() as folder:
        out = os.path.join(folder, "views.png")
        command = [RELIEF, "render", "--series", SERIES, "--adapter", "cpu", "--preset", "bone", "--layout", layout, "--out", out]
        command += ["--azimuth-deg", "20", "--elevation-deg", "10", "--zoom", "1", "--frame", "tissue", "--size", "480x270"]
        subprocess.run([*command, *more], check=True, capture_output=True)
        return numpy.asarray(Image.open(out).convert("RGB")).astype(int)


def stacked(server, query):
    """The answer of the server as an array, or its status."""
    try:
        answer = urllib.request.urlopen(f"{server.url}/v1/session/rest/views?{query}")
    except urllib.error.HTTPError as refused:
        return {"status": refused.code, "code": json.load(refused)["code"]}
    if answer.status != 200:
        return {"status": answer.status}
    return numpy.asarray(Image.open(io.BytesIO(answer.read())).convert("RGB")).astype(int)


def psnr(one, other):
    return float(10 * numpy.log10(65025 / max(((one - other) ** 2).mean(), 1e-9)))


def seen(browser, server, page_of, wait_for, wait_still, pixels):
    def at_rest(more):
        page, problems = page_of(browser, f"{server.url}{ADDRESS}{more}")
        wait_still(page)
        wait_for(page, f"{ROOT}.views === 'true'", 60)
        return page, problems, pixels(page.locator("#frame").screenshot())

    pair = rendered("stereo", "--views", "true")
    left, right = pair[:, :480], pair[:, 480:]
    different = lambda one, other: int((one != other).any(axis=2).sum()) if one.shape == other.shape else -1
    page, problems, shot = at_rest("&output=stereo")
    found = {"lit": int((pair > 40).any(axis=2).sum()), "stereo": different(shot, pair)}
    page.keyboard.press("m")
    page.wait_for_selector("#menu[open]")
    page.wait_for_timeout(1200)
    found["facts"] = page.inner_text("#facts")
    page.keyboard.press("m")
    # Half as wide a screen: the same eyes are twice as far apart in terms of its width.
    wide, _, doubled = at_rest("&output=stereo&span=0.5&inches=21")
    found["inches"] = different(doubled, pair)
    wide.close()
    lines, _, shot = at_rest("&output=lines&swap")
    rows = numpy.arange(SIZE[1])[:, None, None]
    found["lines"] = different(shot, numpy.where(rows % 2 == 0, right, left))
    lines.close()
    kept, _ = page_of(browser, f"{server.url}{ADDRESS}&output=stereo&rest=synthesised")
    wait_still(kept)
    warped = pixels(kept.locator("#frame").screenshot())
    kept.wait_for_timeout(1000)
    found["synthesised"] = kept.evaluate(f"{ROOT}.views ?? null")
    kept.close()
    refined = stacked(server, "eyes=-0.5,0.5&quality=refined")
    refined = numpy.concatenate([refined[:270], refined[270:]], 1)
    found["db"] = {"warped": psnr(warped, pair), "refined": psnr(refined, pair)}
    found["middle"] = different(stacked(server, "eyes=0"), rendered("color"))
    found["refused"] = {query: stacked(server, query) for query in ("eyes=17", "eyes=", "eyes=0&quality=best", "eyes=" + ",".join(17 * ["0"]))}
    found["other"] = stacked(server, "eyes=0&frame=999999")
    # Moved: the views go, and come again.
    before = int(page.evaluate(f"{ROOT}.frame"))
    page.keyboard.press("ArrowRight")
    wait_for(page, f"Number({ROOT}.frame) > {before} && {ROOT}.views === undefined")
    wait_for(page, f"{ROOT}.views === 'true'", 60)
    found["moved"] = different(pixels(page.locator("#frame").screenshot()), pair) > 1000
    found["problems"] = problems
    page.close()
    refused, _ = page_of(browser, f"{server.url}/kiosk?output=stereo&rest=never")
    wait_for(refused, f"{ROOT}.connection === 'ended'")
    found["never"] = refused.inner_text("#state")
    refused.close()
    return found
