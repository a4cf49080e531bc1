"""Renders media with Mitsuba 3, to compare Relief's path tracer with.

usage: pathtrace_peer.py WORK.json

Reads scenes as tests/render/pathtrace_peer.rs writes them: extinction per mm and albedo on grids whose
values lie in the middle of their cells, an orthographic camera, distant lights and an environment. Writes
for each the linear light of the picture, rows from the top, as 64-bit floats.
"""

import json
import sys

import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")
from mitsuba import ScalarTransform4f as T


def grid(values, box):
    """A grid of values inside of a box of patient space."""
    low, high = np.array(box[0]), np.array(box[1])
    place = T().translate(low.tolist()).scale((high - low).tolist())
    return {"type": "gridvolume", "grid": mi.VolumeGrid(values), "to_world": place, "filter_type": "trilinear",
            "raw": True}


def scene(work):
    dims = work["dims"][::-1]
    extinction = np.fromfile(work["extinction"], "<f4").reshape(dims + [1])
    albedo = np.fromfile(work["albedo"], "<f4").reshape(dims + [3])
    low, high = np.array(work["box_mm"][0]), np.array(work["box_mm"][1])
    medium = {
        "type": "heterogeneous",
        "sigma_t": grid(extinction, work["box_mm"]),
        "albedo": grid(albedo, work["box_mm"]),
        "scale": 1.0,
        "phase": {"type": "hg", "g": work["anisotropy"]},
    }
    camera = work["camera"]
    columns, rows = work["size_px"]
    half_width = camera["height_mm"] / 2 * columns / rows
    look = T().look_at(origin=camera["eye_mm"], target=camera["look_at_mm"], up=camera["up"])
    parts = {
        "type": "scene",
        # A light path of Mitsuba's counts the way from the light as well.
        "integrator": {"type": "volpath", "max_depth": work["scatterings"] + 1, "rr_depth": 1000,
                       "hide_emitters": True},
        "sensor": {
            "type": "orthographic",
            # Its picture is 2 units wide.
            "to_world": look @ T().scale([half_width, half_width, 1.0]),
            "near_clip": 0.1,
            "far_clip": 10000.0,
            "film": {"type": "hdrfilm", "width": columns, "height": rows, "rfilter": {"type": "box"},
                     "pixel_format": "rgb", "component_format": "float32"},
            "sampler": {"type": "independent", "sample_count": work["passes"], "seed": 1},
        },
        "body": {
            "type": "cube",
            "to_world": T().translate(((low + high) / 2).tolist()).scale(((high - low) / 2).tolist()),
            "bsdf": {"type": "null"},
            "interior": medium,
        },
    }
    if work["environment"] > 0:
        parts["environment"] = {"type": "constant", "radiance": {"type": "rgb", "value": work["environment"]}}
    for i, light in enumerate(work["lights"]):
        # Relief's light of intensity 1 makes a white surface that faces it 1.
        parts[f"light{i}"] = {
            "type": "directional",
            "direction": [-x for x in light["toward"]],
            "irradiance": {"type": "rgb", "value": [np.pi * c for c in light["rgb"]]},
        }
    return mi.load_dict(parts)


for work in json.load(open(sys.argv[1]))["scenes"]:
    picture = np.array(mi.render(scene(work)), dtype="<f8")[:, :, :3]
    picture.tofile(work["out"])
