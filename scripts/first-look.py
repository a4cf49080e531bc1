# Renders series before and after, measures the pictures, and writes a table and a contact sheet; see scripts/first-look.
#
# usage: first-look.py PROGRAM FOLDER NAME=SERIES...
import json
import os
import pathlib
import subprocess
import sys

import numpy as np
from PIL import Image, ImageDraw

PROGRAM, OUT = sys.argv[1], pathlib.Path(sys.argv[2])
SERIES = [argument.split("=", 1) for argument in sys.argv[3:]]
SIZE = (960, 540)
TILE = (320, 180)
BEFORE = ["--frame", "volume", "--table", "keep", "--depth-range", "volume"]
#: A channel of a picture above this is lit.
LIT = 24


def render(series, name, *options):
    """A picture as RGB, its disparity as bytes, and what the program reports."""
    file = OUT / f"{name}.png"
    command = [PROGRAM, "render", "--series", series, "--layout", "rgbd", "--size", "{}x{}".format(*SIZE)]
    command += ["--out", str(file), "--json", *options]
    done = subprocess.run(command, env={**os.environ, "RELIEF_ADAPTER": "software"}, capture_output=True, text=True)
    if done.returncode:
        sys.exit(done.stderr)
    both = np.asarray(Image.open(file).convert("RGB"))
    return both[:, : SIZE[0]], both[:, SIZE[0] :, 0], json.loads(done.stdout)


def covered(color):
    """The larger share of width and height between the outermost lit pixels, per cent."""
    lit = color.max(axis=2) > LIT
    ends = [np.flatnonzero(lit.any(axis=axis)) for axis in (0, 1)]
    return max(100 * (at[-1] + 1 - at[0]) / side for at, side in zip(ends, SIZE)) if lit.any() else 0


def disparity(color, depth):
    """The share of the disparity range between two percentiles of the lit pixels, per cent."""
    seen = depth[color.max(axis=2) > LIT]
    low, high = np.percentile(seen, [1, 99]) if seen.size else (0, 0)
    return 100 * (high - low) / 255


def measured(name, series):
    """Table row of a series, and its pictures before and after."""
    cells, pictures = [], []
    for preset in ["bone", "skin", None]:
        options = ["--preset", preset] if preset else []
        shown = []
        for when, more in [("before", BEFORE), ("after", [])]:
            color, depth, report = render(series, f"{name}-{preset or 'chosen'}-{when}", *options, *more)
            shown.append([covered(color), disparity(color, depth)])
            if preset == "bone" or (preset is None and when == "after"):
                pictures.append(Image.fromarray(color).resize(TILE, Image.Resampling.LANCZOS))
        cells += ["{:.0f} → {:.0f}".format(shown[0][i], shown[1][i]) for i in range(2)]
    chosen = (report["chosen"] or "").split(" for ")[0].removeprefix("preset ")
    return [name, *cells, chosen], pictures


def main():
    rows, sheet = [], Image.new("RGB", (3 * TILE[0], len(SERIES) * TILE[1]))
    for at, (name, series) in enumerate(SERIES):
        row, pictures = measured(name, series)
        rows.append(row)
        print("  ".join(row), flush=True)
        for column, picture in enumerate(pictures):
            ImageDraw.Draw(picture).text((6, 4), f"{name}: {['bone, before', 'bone', row[-1]][column]}", fill=(230, 230, 230))
            sheet.paste(picture, (column * TILE[0], at * TILE[1]))
    lines = ["| series | bone: side | disparity | skin: side | disparity | chosen: side | disparity | chosen |", "|---" * 8 + "|"]
    lines += [f"| {' | '.join(row)} |" for row in rows]
    (OUT / "first-look.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    sheet.save(OUT / "first-look.jpg", quality=85)


main()
