# Writes the scenes that compare-modes renders.
"""Writes the scenes that compare-modes renders: each given scene once for every mode.

usage: scenes_of_modes.py --out FOLDER [--only MODE] SCENE.json ...

The camera, the size and the light are the scene's own; what else a mode needs is in CHANGES.
"""
import argparse
import json
import pathlib
import sys

AIR = {"points": [{"hu": -1024, "rgba": [1.0, 1.0, 0.9, 1.0]}, {"hu": -900, "rgba": [0.3, 0.6, 0.9, 0.9]},
                  {"hu": -600, "rgba": [0.1, 0.1, 0.4, 0.6]}, {"hu": 200, "rgba": [0.0, 0.0, 0.0, 0.0]}]}
# From the smallest to the largest value of the series, which VTK takes for black and white.
RAMP = {"points": [{"hu": -1000, "rgba": [0.0, 0.0, 0.0, 1.0]}, {"hu": 1979, "rgba": [1.0, 1.0, 1.0, 1.0]}]}
WITHIN_THE_CHEST = {"box_mm": [[-100, 60, -620], [100, 220, -480]]}
TWO_SURFACES = [{"hu": -300, "rgb": [0.9, 0.6, 0.5], "opacity": 0.4}, {"hu": 300, "rgb": [1.0, 0.95, 0.85]}]
# Where samples lie otherwise shows: VTK begins at a clip plane.
FINE_MM = 0.25
# VTK lights a surface by the gradient at the first sample behind it: on it only where samples are close.
ON_SURFACE_MM = 0.1


def fainter(transfer):
    points = [{**point, "rgba": [*point["rgba"][:3], point["rgba"][3] / 10]} for point in transfer["points"]]
    return {**transfer, "points": points}


# By the name of what is compared: the mode, and what differs from the scene.
CHANGES = {
    "composite": lambda scene: {"mode": "composite"},
    "mip": lambda scene: {"mode": "mip"},
    "minip": lambda scene: {"mode": "minip", "transfer": AIR, "clip": WITHIN_THE_CHEST, "sample_distance_mm": FINE_MM},
    "mean": lambda scene: {"mode": "mean", "transfer": RAMP},
    "average": lambda scene: {"mode": "average"},
    "additive": lambda scene: {"mode": "additive", "transfer": fainter(scene["transfer"])},
    "isosurface-bone": lambda scene: {"mode": "isosurface", "iso_hu": 300, "sample_distance_mm": ON_SURFACE_MM},
    "isosurface-two": lambda scene: {"mode": "isosurface", "surfaces": TWO_SURFACES, "sample_distance_mm": ON_SURFACE_MM},
}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", required=True, type=pathlib.Path)
    parser.add_argument("--only")
    parser.add_argument("scenes", nargs="+", type=pathlib.Path)
    arguments = parser.parse_args()
    names = [name for name in CHANGES if arguments.only in (None, name.split("-")[0])]
    if not names:
        sys.exit(f"no mode is called {arguments.only}")
    for path in arguments.scenes:
        scene = json.loads(path.read_text(encoding="utf-8"))
        for name in names:
            changed = {**scene, **CHANGES[name](scene)}
            file = arguments.out / f"{path.stem}-{name}.json"
            file.write_text(json.dumps(changed, indent=1), encoding="utf-8")


if __name__ == "__main__":
    main()
