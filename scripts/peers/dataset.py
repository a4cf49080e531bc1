# Reads a dataset of `relief batch` as OpenCV, COLMAP and NeRF's readers do, and says how far off places come out.
"""Reads a dataset of `relief batch` as others do, and says how far from their pixels its places come out.

usage: dataset.py OUT

The places are those of points3D.txt, each with the pixel of the image that it was seen in. They go through cv2.projectPoints with K
and [R|t] of dataset.jsonl, through the quaternions and pinholes of COLMAP's text model by the rules of COLMAP's documentation, and
through transforms.json with OpenGL's axes. With pycolmap installed, its own reader projects them, too. Prints JSON: the largest
distances in pixels, and how far from a ball of 80 mm at the origin the places lie, in mm (median).
"""
import json
import os
import sys

import cv2
import numpy as np

out = sys.argv[1]
lines = [json.loads(line) for line in open(os.path.join(out, "dataset.jsonl"))]
told = {"views": len(lines), "points": 0, "opencv_px": 0.0, "colmap_px": 0.0, "nerf_px": 0.0, "pycolmap": None}
radii = []


def rotation(w, x, y, z):
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])


for series in sorted({line["series"] for line in lines}):
    folder = os.path.join(out, series)
    text = lambda name: [line.split() for line in open(os.path.join(folder, "sparse/0", name)) if not line.startswith("#")]
    cameras = {row[0]: row[1:] for row in text("cameras.txt")}
    places = {row[0]: np.array(row[1:4], float) for row in text("points3D.txt")}
    frames = {frame["file_path"]: frame for frame in json.load(open(os.path.join(folder, "transforms.json")))["frames"]}
    images = text("images.txt")
    for head, seen in zip(images[::2], images[1::2]):
        name = head[9]
        pixels = np.array([[float(x), float(y)] for x, y in zip(seen[::3], seen[1::3])])  # the first one's corner is (0, 0)
        points = np.array([places[place] for place in seen[2::3]])
        told["points"] += len(points)
        radii += list(abs(np.linalg.norm(points, axis=1) - 80))
        line = next(line for line in lines if line["color"] == f"{series}/{name}")
        pose, k = np.array(line["camera_from_patient"]), np.array(line["K"])
        put, _ = cv2.projectPoints(points, cv2.Rodrigues(pose[:3, :3])[0], pose[:3, 3], k, None)
        told["opencv_px"] = max(told["opencv_px"], float(abs(put[:, 0] + 0.5 - pixels).max()))
        q, t = np.array(head[1:5], float), np.array(head[5:8], float)
        model, width, height, fx, fy, cx, cy = cameras[head[8]]
        assert model == "PINHOLE" and [int(width), int(height)] == line["size_px"]
        put = points @ rotation(*q).T + t
        put = put[:, :2] / put[:, 2:] * [float(fx), float(fy)] + [float(cx), float(cy)]
        told["colmap_px"] = max(told["colmap_px"], float(abs(put - pixels).max()))
        frame = frames[name]
        view = np.linalg.inv(np.array(frame["transform_matrix"]))
        put = points @ view[:3, :3].T + view[:3, 3]
        assert (put[:, 2] < 0).all(), "OpenGL looks along -z"
        put = put[:, :2] / -put[:, 2:] * [frame["fl_x"], -frame["fl_y"]] + [frame["cx"], frame["cy"]]
        told["nerf_px"] = max(told["nerf_px"], float(abs(put - pixels).max()))
        assert os.path.exists(os.path.join(folder, name)) and os.path.exists(os.path.join(folder, frame["depth_file_path"]))
    try:
        import pycolmap
    except ImportError:
        continue
    read = pycolmap.Reconstruction(os.path.join(folder, "sparse/0"))
    worst = told["pycolmap"] or 0.0
    for image in read.images.values():
        for point in image.points2D:
            put = image.project_point(read.points3D[point.point3D_id].xyz)
            worst = max(worst, float(abs(put - point.xy).max()))
    told["pycolmap"] = worst
told["ball_mm"] = float(np.median(radii))
print(json.dumps(told))
