# Renders pictures with true depth, for training and testing the depth network.
"""Pictures with true depth, for training and testing the depth network.

Makes procedural volumes, renders random views of them and of given series with `relief batch`, and packs the pictures
into one file of NumPy arrays: `color` (N, 216, 384, 3) as bytes, `closeness` (N, 216, 384) as bytes, and the name of the
series of each picture.

Closeness is what the network learns. It is 0 where a ray hits nothing. Elsewhere it is linear in view depth: 1 at the
nearest visible surface, 0.1 at the farthest, between the 1st and the 99th percentile of the picture's depth.
"""

import argparse
import json
import pathlib
import random
import subprocess

import numpy as np
from PIL import Image

RENDERED_PX = (768, 432)
STORED_PX = (384, 216)
FARTHEST_VISIBLE = 0.1
"""Closeness of the farthest visible surface: above the background's 0, because it lies in front of it."""
PRESETS = ["bone", "bone-dense", "bone-translucent", "spine", "skin", "skin", "soft-tissue", "skin-and-bone",
           "muscle", "fat", "lung", "airways", "pulmonary-vessels", "vessels", "aorta", "kidneys", "heart"]
LIGHTS = ["headlight", "studio", "side", "above"]


def random_solids(seed, side=112):
    """A volume in HU of overlapping ellipsoids, tubes and boxes, some of them hollow: (z, y, x) as int16."""
    draw = np.random.default_rng(seed)
    z, y, x = np.meshgrid(*[np.linspace(-1, 1, side, dtype=np.float32)] * 3, indexing="ij")
    at = np.stack([x, y, z], axis=-1)
    volume = np.full((side, side, side), -1000, np.float32)
    for _ in range(draw.integers(4, 16)):
        turn, _ = np.linalg.qr(draw.normal(size=(3, 3)))
        local = (at - draw.uniform(-0.55, 0.55, 3).astype(np.float32)) @ turn.astype(np.float32)
        half = draw.uniform(0.06, 0.5, 3).astype(np.float32)
        kind = draw.integers(3)
        if kind == 0:
            distance = np.sqrt(((local / half) ** 2).sum(-1))
        elif kind == 1:
            bend = local[..., 0] - 0.3 * np.sin(3 * local[..., 2] + draw.uniform(0, 6))
            distance = np.maximum(np.hypot(bend, local[..., 1]) / (0.4 * half[0] + 0.02), np.abs(local[..., 2]) / 0.8)
        else:
            distance = np.abs(local / half).max(-1)
        inside = distance < 1
        if draw.random() < 0.3:
            inside &= distance > 0.8
        volume[inside] = draw.choice([-80, 40, 120, 260, 500, 900, 1400])
    volume += draw.normal(0, 12, volume.shape)
    return np.clip(volume, -1024, 3000).astype(np.int16)


def write_nrrd(path, volume, spacing_mm):
    """A volume as an uncompressed NRRD file in patient LPS mm."""
    sizes = " ".join(str(n) for n in reversed(volume.shape))
    directions = " ".join(f"({','.join(str(spacing_mm if i == k else 0) for k in range(3))})" for i in range(3))
    header = (f"NRRD0004\ntype: short\ndimension: 3\nspace: left-posterior-superior\nsizes: {sizes}\n"
              f"space directions: {directions}\nspace origin: (0,0,0)\nendian: little\nencoding: raw\n\n")
    path.write_bytes(header.encode() + volume.astype("<i2").tobytes())


def random_view(draw, number):
    """One view of a batch: direction, colours, light, background, and at times a cut."""
    scene = {"transfer": draw.choice(PRESETS), "size_px": list(RENDERED_PX)}
    shade = draw.random()
    if shade < 0.5:
        scene["background_rgb"] = [0, 0, 0]
    else:
        scene["background_rgb"] = [round(draw.random(), 3) for _ in range(3)]
    if draw.random() < 0.35:
        scene["lights"] = draw.choice(LIGHTS)
    scene["frame"] = draw.choice(["visible", "visible", "tissue"])
    return {"name": f"v{number:04}", "azimuth_deg": round(draw.uniform(-180, 180), 1),
            "elevation_deg": round(max(-80.0, min(80.0, draw.gauss(5, 28))), 1), "scene": scene}


def closeness(depth_tenths):
    """Depth in tenths of a millimetre, 0 where nothing is hit, as closeness in bytes. `None` where too little is visible."""
    hit = depth_tenths > 0
    if hit.mean() < 0.03:
        return None
    depth = depth_tenths.astype(np.float32)
    near, far = np.percentile(depth[hit], [1, 99])
    if far - near < 20:
        return None
    share = np.clip((far - depth) / (far - near), 0, 1)
    value = np.where(hit, FARTHEST_VISIBLE + (1 - FARTHEST_VISIBLE) * share, 0)
    return np.round(value * 255).astype(np.uint8)


def render(program, series, out, count, seed, zoom):
    """Renders views of one series and returns colours and closeness."""
    draw = random.Random(seed)
    out.mkdir(parents=True, exist_ok=True)
    (out / "views.json").write_text(json.dumps([random_view(draw, number) for number in range(count)]))
    table = out / "series.csv"
    table.write_text(f"path,name\n{series.resolve()},s\n")
    subprocess.run([program, "batch", "plan", "--table", table, "--views", out / "views.json", "--zoom", str(zoom),
                    "--products", "color,depth-png", "--out", out / "jobs.jsonl"], check=True, stdout=subprocess.DEVNULL,
                   stderr=subprocess.DEVNULL)
    subprocess.run([program, "batch", "run", "--manifest", out / "jobs.jsonl", "--out", out / "views", "--adapter", "cpu"],
                   check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    colors, near = [], []
    for path in sorted((out / "views").glob("*/v*.depth.png")):
        depth = np.asarray(Image.open(path).resize(STORED_PX, Image.Resampling.NEAREST)).astype(np.int32)
        value = closeness(depth)
        if value is None:
            continue
        color = Image.open(str(path).replace(".depth.png", ".color.png")).convert("RGB")
        colors.append(np.asarray(color.resize(STORED_PX, Image.Resampling.BOX)))
        near.append(value)
    return colors, near


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", default="relief", help="the command relief")
    parser.add_argument("--work", type=pathlib.Path, required=True, help="folder for volumes and pictures, which stay there")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="file of arrays to write: .npz")
    parser.add_argument("--solids", type=int, default=0, help="number of random volumes to make")
    parser.add_argument("--heads", type=int, default=0, help="number of procedural heads to make")
    parser.add_argument("--views", type=int, default=120, help="views of each made volume")
    parser.add_argument("--series-views", type=int, default=400, help="views of each given series")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("series", nargs="*", type=pathlib.Path, help="series: folders or files that relief reads")
    given = parser.parse_args()
    given.work.mkdir(parents=True, exist_ok=True)
    volumes = [(path, given.series_views) for path in given.series]
    for number in range(given.heads):
        path = given.work / f"head-{given.seed + number}"
        subprocess.run([given.program, "phantom", "--size", "160", "--seed", str(given.seed + number), "--force", "--out", path],
                       check=True, stdout=subprocess.DEVNULL)
        volumes.append((path, given.views))
    for number in range(given.solids):
        path = given.work / f"solids-{given.seed + number}.nrrd"
        write_nrrd(path, random_solids(given.seed + number), 2.0)
        volumes.append((path, given.views))
    colors, near, names = [], [], []
    for number, (path, count) in enumerate(volumes):
        for part, zoom in enumerate([1.0, 1.6, 0.7]):
            found = render(given.program, path, given.work / "rendered" / f"{number:03}-{part}", max(1, count // 3),
                           given.seed * 1000 + number * 3 + part, zoom)
            colors += found[0]
            near += found[1]
            names += [path.name] * len(found[0])
        print(f"{path.name}: {len(colors)} pictures so far", flush=True)
    np.savez(given.out, color=np.array(colors), closeness=np.array(near), series=np.array(names))


if __name__ == "__main__":
    main()
