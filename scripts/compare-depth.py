# Renders pictures by two depth rules, makes views of them, and compares these with true ones; see scripts/compare-depth.
#
# usage: compare-depth.py PROGRAM FOLDER NAME=SERIES...

import json
import pathlib
import statistics
import subprocess
import sys

import numpy
from PIL import Image

PROGRAM, FOLDER = sys.argv[1], pathlib.Path(sys.argv[2])
PRESETS = {
    "lidc-idri-0314": ["skin-and-bone", "bone"], "crlm-ct-1004": ["kidneys", "bone"], "totalseg-abdomen-j2k": ["skin-and-bone"],
    "sts-001-thigh": ["skin-and-bone", "skin"],
}
#: Cases of the animation.
WIGGLED = {"lidc-idri-0314": ["skin-and-bone"], "crlm-ct-1004": ["kidneys"]}
WIDTH, HEIGHT = 960, 540
#: Name, layout, eye separations from the first to the last view.
CONDITIONS = [("nine views over 4", "views-9x1", 4), ("a pair of eyes", "views-2x1", 1), ("nine views, ±17°", "views-9x1", 17.9)]
RULES = ["threshold", "views"]


def rendered(path, *options):
    path.unlink(missing_ok=True)
    made = subprocess.run([PROGRAM, "render", *options, "--adapter", "cpu", "--json", "--out", path], check=True, capture_output=True, text=True)
    return numpy.asarray(Image.open(path).convert("RGB")).astype(numpy.float32), json.loads(made.stdout)


def one_layer(frame, path, layout, span):
    """Views that a display makes of a frame with one layer."""
    path.unlink(missing_ok=True)
    options = ["--layout", layout, "--view-span", str(span), "--profile", "philips-42"]
    subprocess.run([PROGRAM, "preview", frame, *options, "--out", path], check=True, capture_output=True)
    return numpy.asarray(Image.open(path).convert("RGB")).astype(numpy.float32)


def wiggle(path, cases):
    """Writes an animation of every second view of each case, forwards and backwards, with both rules beside each other."""
    rows = []
    for series, preset in cases:
        views = ["--series", series, "--preset", preset, "--azimuth-deg", "25", "--elevation-deg", "10", "--size", "300x216"]
        views += ["--layout", "views-9x1", "--view-span", "4"]
        rows.append([rendered(FOLDER / "made.png", *views, "--depth-rule", rule)[0].reshape(216, 9, 300, 3) for rule in RULES])
    frames = [numpy.concatenate([numpy.concatenate([rule[:, view] for rule in row], axis=1) for row in rows]) for view in range(0, 9, 2)]
    pictures = [Image.fromarray(frame.astype(numpy.uint8)).quantize(64, dither=Image.Dither.NONE) for frame in frames + frames[-2:0:-1]]
    pictures[0].save(path, save_all=True, append_images=pictures[1:], duration=150, loop=0, optimize=True)


def flicker_db(series, preset):
    """The flicker of two views, two eye separations to the left and to the right, while the volume turns by 1 degree a frame.

    An error is the difference between a synthesised and a rendered view. The result is the PSNR between the errors of successive frames: a
    view without flicker has equal errors.
    """
    errors = {rule: [] for rule in RULES}
    for azimuth in range(25, 29):
        base = ["--series", series, "--preset", preset, "--azimuth-deg", str(azimuth), "--elevation-deg", "10", "--size", f"{WIDTH}x{HEIGHT}"]
        base += ["--layout", "views-2x1", "--view-span", "4", "--depth-range", "volume"]
        true, _ = rendered(FOLDER / "true.png", *base, "--views", "true")
        for rule in RULES:
            errors[rule].append(rendered(FOLDER / "made.png", *base, "--depth-rule", rule)[0] - true)
    steps = {rule: [((now - before) ** 2).mean() for before, now in zip(all, all[1:])] for rule, all in errors.items()}
    return [round(float(10 * numpy.log10(255**2 / statistics.mean(steps[rule]))), 2) for rule in RULES]


def psnr_of_outer(true, made):
    """The mean over the views but for the middle one, which is the picture itself."""
    count = true.shape[1] // WIDTH
    views = [slice(at * WIDTH, (at + 1) * WIDTH) for at in range(count) if 2 * at + 1 != count]
    return statistics.mean(10 * numpy.log10(255**2 / max(((true[:, view] - made[:, view]) ** 2).mean(), 1e-6)) for view in views)


def main():
    rows, found, sheet = [], [], []
    for case in sys.argv[3:]:
        name, series = case.split("=", 1)
        for preset in PRESETS.get(name, ["bone"]):
            base = ["--series", series, "--preset", preset, "--azimuth-deg", "25", "--elevation-deg", "10", "--size", f"{WIDTH}x{HEIGHT}"]
            row = {"series": name, "preset": preset}
            frame = {rule: FOLDER / f"{rule}.png" for rule in RULES}
            frames = [[rendered(frame[rule], *base, "--layout", "rgbd", "--depth-rule", rule) for rule in RULES] for _ in range(5)]
            for condition, layout, span in CONDITIONS:
                views = [*base, "--layout", layout, "--view-span", str(span)]
                true, _ = rendered(FOLDER / "true.png", *views, "--views", "true")
                made = [one_layer(frame[rule], FOLDER / "made.png", layout, span) for rule in RULES]
                made.append(rendered(FOLDER / "made.png", *views, "--depth-rule", "views")[0])
                row[condition] = [round(float(psnr_of_outer(true, views)), 2) for views in made]
            row["turning by 1°"] = flicker_db(series, preset)
            times = [statistics.median(frame[rule][1]["render_ms"] for frame in frames) for rule in range(2)]
            row["ms"] = [round(ms) for ms in times]
            rays, views = (frame for frame, _ in frames[0])
            sheet.append(numpy.concatenate([rays, views[:, WIDTH:]], axis=1))
            found.append(row)
            print(json.dumps(row), flush=True)
    (FOLDER / "depth.json").write_text(json.dumps(found, indent=1))
    picture = Image.fromarray(numpy.concatenate(sheet).astype(numpy.uint8))
    picture.resize((3 * WIDTH // 3, len(sheet) * HEIGHT // 3), Image.LANCZOS).save(FOLDER / "depth.jpg", quality=88)
    wiggled = [(case, preset) for case in sys.argv[3:] for preset in WIGGLED.get(case.split("=", 1)[0], [])]
    if wiggled:
        wiggle(FOLDER / "wiggle.gif", [(case.split("=", 1)[1], preset) for case, preset in wiggled])
    names = [condition for condition, *_ in CONDITIONS] + ["turning by 1°"]
    rows += ["| series, preset | " + " | ".join(names) + " | time |", "|---|" + "---|" * (len(names) + 1)]
    for row in found:
        cells = [" → ".join(f"{db:.1f}" for db in row[name]) for name in names]
        rays, views = row["ms"]
        rows.append(f"| {row['series']}, {row['preset']} | " + " | ".join(cells) + f" | {rays} → {views} ms, x {views / rays:.2f} |")
    (FOLDER / "depth.md").write_text("\n".join(rows) + "\n")
    print("\n".join(rows))


main()
