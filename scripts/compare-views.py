# Renders views, makes the same views of depth, measures how far they are apart, and writes a table; see scripts/compare-views.
#
# usage: compare-views.py PROGRAM FOLDER NAME=SERIES...
"""IV-PSNR follows Dziembowski et al., IEEE TCSVT 32(11), 2022: differences are taken to the most similar pixel within two
pixels, after the mean difference of each component was corrected by at most one per cent, in both directions; the smaller
one counts. Y, Cb and Cr (BT.709) have the weights 4:1:1."""

import json
import pathlib
import statistics
import subprocess
import sys

import flip_evaluator
import numpy
from PIL import Image
from skimage.metrics import structural_similarity

PROGRAM, FOLDER = sys.argv[1], pathlib.Path(sys.argv[2])
PRESETS = {
    "head": ["bone"], "phantom-skull-5mm": ["bone"], "phantom-skull-tilt-m18.5": ["bone"],
    "lidc-idri-0314": ["bone", "skin-and-bone"], "crlm-ct-1004": ["bone", "kidneys"],
}
ONE_DEGREE = 1900 * numpy.tan(numpy.radians(1)) / 65
#: Name, layout, distance of the outermost views in eye separations, picture.
CONDITIONS = [
    ("a pair of eyes", "views-2x1", 1.0, "960x540"),
    ("nine views, ±17°", "views-9", 17.9, "960x540"),
    ("eye moved by 1°", "views-2x1", 2 * ONE_DEGREE, "960x540"),
    ("eye moved by 2°", "views-2x1", 4 * ONE_DEGREE, "960x540"),
    ("eye moved by 5°", "views-2x1", 10 * ONE_DEGREE, "960x540"),
    ("quilt of 45, ±20° at 0.5 m", "views-5x9", 5.6, "420x560"),
]
#: scripts/compare-depth measures rule views.
RAYS = ["--depth-rule", "threshold"]
METHODS = {
    "one layer": RAYS, "two layers": ["--depth-rule", "two-layer"],
    "interpolated": [*RAYS, "--views", "interpolated"], "refined": [*RAYS, "--views", "refined"],
}


def run(*arguments):
    made = subprocess.run([PROGRAM, *arguments], check=True, capture_output=True, text=True)
    return json.loads(made.stdout)


def views_of(path, layout, size):
    """The views of a quilt, in any order that is the same for all quilts of a layout."""
    width, height = (int(side) for side in size.split("x"))
    quilt = numpy.asarray(Image.open(path).convert("RGB"))
    return [quilt[y : y + height, x : x + width] for y in range(0, quilt.shape[0], height) for x in range(0, quilt.shape[1], width)][
        : 9 if layout == "views-9" else None
    ]


def psnr(squared):
    return 99.0 if squared <= 0 else min(99.0, 10 * numpy.log10(255**2 / squared))


def components(rgb):
    r, g, b = (rgb[..., i].astype(numpy.float64) for i in range(3))
    y = 0.2126 * r + 0.7152 * g + 0.0722 * b
    return [y, 128 + (b - y) / 1.8556, 128 + (r - y) / 1.5748]


def iv_psnr(one, other):
    def directed(a, b):
        total = 0
        for x, y, weight in zip(components(a), components(b), (4, 1, 1)):
            offset = numpy.clip((x - y).mean(), -2.55, 2.55)
            padded = numpy.pad(y, 2, mode="edge")
            shifted = (padded[dy : dy + y.shape[0], dx : dx + y.shape[1]] for dy in range(5) for dx in range(5))
            least = numpy.full(x.shape, numpy.inf)
            for moved in shifted:
                numpy.minimum(least, (x - moved - offset) ** 2, out=least)
            total += weight / 6 * psnr(least.mean())
        return total

    return min(directed(one, other), directed(other, one))


def flip(true, made):
    _, mean, _ = flip_evaluator.evaluate(true.astype(numpy.float32) / 255, made.astype(numpy.float32) / 255, "LDR", applyMagma=False)
    return mean


def measured(true, made):
    """Means over the views that are not equal at once: that of the middle is the picture itself."""
    pairs = [(a, b) for a, b in zip(true, made)]
    squared = [((a.astype(float) - b) ** 2).mean() for a, b in pairs]
    some = [pair for pair, error in zip(pairs, squared) if error > 0][::5] or pairs[:1]
    return {
        "psnr": statistics.mean(psnr(error) for error in squared if error > 0) if any(squared) else 99.0,
        "ssim": statistics.mean(structural_similarity(a, b, channel_axis=2) for a, b in some),
        "iv": statistics.mean(iv_psnr(a, b) for a, b in some),
        "flip": statistics.mean(flip(a, b) for a, b in some),
    }


def main():
    rows, found = [], []
    for case in sys.argv[3:]:
        name, series = case.split("=", 1)
        for preset in PRESETS.get(name, ["bone"]):
            for condition, layout, span, size in CONDITIONS:
                base = ["render", "--series", series, "--preset", preset, "--azimuth-deg", "25", "--elevation-deg", "10", "--layout", layout]
                base += ["--view-span", f"{span:.3f}", "--size", size, "--adapter", "cpu", "--json", "--out"]
                made = run(*base, FOLDER / "true.png", "--views", "true")
                true, true_ms = views_of(FOLDER / "true.png", layout, size), made["views"]["views_ms"]
                for method, options in METHODS.items():
                    if method == "interpolated" and layout == "views-2x1":
                        continue
                    repeats = [run(*base, FOLDER / "made.png", *options) for _ in range(3)]
                    views_ms = statistics.median(made["views"]["views_ms"] for made in repeats)
                    render_ms = statistics.median(made["render_ms"] for made in repeats)
                    row = {"series": name, "preset": preset, "condition": condition, "method": method}
                    row |= measured(true, views_of(FOLDER / "made.png", layout, size))
                    # The views of a renderer are pictures each; those that are made need the one that they are made of.
                    row |= {"views_ms": views_ms, "render_ms": render_ms, "true_ms": true_ms, "share": (views_ms + render_ms) / true_ms}
                    found.append(row)
                    print(row, flush=True)
    (FOLDER / "views.json").write_text(json.dumps(found, indent=1))
    for condition, *_ in CONDITIONS:
        rows += ["", f"**{condition}**", "", "| series, preset | " + " | ".join(METHODS) + " |", "|---|" + "---|" * len(METHODS)]
        for name, preset in dict.fromkeys((row["series"], row["preset"]) for row in found):
            cells = []
            for method in METHODS:
                row = next((r for r in found if (r["series"], r["preset"], r["condition"], r["method"]) == (name, preset, condition, method)), None)
                figures = row and f"{row['psnr']:.1f} / {row['ssim']:.3f} / {row['iv']:.1f} / {row['flip']:.3f}; {row['views_ms']:.0f} ms, {100 * row['share']:.0f} %"
                cells.append(figures or "–")
            rows.append(f"| {name}, {preset} | " + " | ".join(cells) + " |")
    (FOLDER / "views.md").write_text("\n".join(rows) + "\n")
    print("\n".join(rows))


main()
