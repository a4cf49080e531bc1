# Poses of OpenCV, PoseLib and IPOPT (through CasADi) for the views of `relief track views`, against Relief's own.
#
# usage: poses.py VIEWS.json
#
# Each peer gets the same pixels and camera. Prints one JSON object: for each peer the largest angle (degrees) and distance
# (mm) to Relief's pose over the views in which both found the same minimum, how often the peer's minimum is better or
# worse (by 1e-6 px² of the summed squared errors), and its median time in µs. For Relief: error over the Cramer-Rao bound
# is not judged here; the truth is in the file.
import json
import sys
import time

import casadi
import cv2
import numpy as np
import poselib

work = json.load(open(sys.argv[1]))
K = np.array(work["camera_matrix"]).reshape(3, 3)
distortion = np.array(work["distortion"])
leds = np.array(work["leds_mm"])


def cost(R, t, pixels):
    projected, _ = cv2.projectPoints(leds, cv2.Rodrigues(R)[0], t, K, distortion)
    return float(np.sum((projected.reshape(-1, 2) - pixels) ** 2))


def opencv(pixels, _):
    ok, r, t = cv2.solvePnP(leds, pixels, K, distortion, flags=cv2.SOLVEPNP_SQPNP)
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 200, 1e-15)
    r, t = cv2.solvePnPRefineLM(leds, pixels, K, distortion, r, t, criteria)
    return cv2.Rodrigues(r)[0], t.ravel()


def by_poselib(pixels, _):
    camera = {
        "model": "OPENCV",
        "width": 1024,
        "height": 768,
        "params": [K[0, 0], K[1, 1], K[0, 2], K[1, 2], *distortion[:4]],
    }
    ransac = {"max_reproj_error": 50.0, "max_iterations": 100}
    bundle = {"max_iterations": 200, "gradient_tol": 1e-14, "step_tol": 1e-14, "loss_type": "TRIVIAL"}
    pose, _ = poselib.estimate_absolute_pose(pixels, leds, camera, ransac, bundle)
    return pose.R, pose.t


def make_ipopt():
    x, uv = casadi.MX.sym("x", 7), casadi.MX.sym("uv", 2, len(leds))
    w, a, b, c = x[0], x[1], x[2], x[3]
    R = casadi.vertcat(
        casadi.horzcat(1 - 2 * (b * b + c * c), 2 * (a * b - w * c), 2 * (a * c + w * b)),
        casadi.horzcat(2 * (a * b + w * c), 1 - 2 * (a * a + c * c), 2 * (b * c - w * a)),
        casadi.horzcat(2 * (a * c - w * b), 2 * (b * c + w * a), 1 - 2 * (a * a + b * b)),
    )
    total, depths = 0, []
    k1, k2, p1, p2, k3 = distortion
    for i, led in enumerate(leds):
        p = R @ led / 100 + x[4:7]
        depths.append(p[2])
        px, py = p[0] / p[2], p[1] / p[2]
        r2 = px * px + py * py
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        dx = px * radial + 2 * p1 * px * py + p2 * (r2 + 2 * px * px)
        dy = py * radial + p1 * (r2 + 2 * py * py) + 2 * p2 * px * py
        total += (K[0, 0] * dx + K[0, 1] * dy + K[0, 2] - uv[0, i]) ** 2 + (K[1, 1] * dy + K[1, 2] - uv[1, i]) ** 2
    problem = {"x": x, "f": total, "g": casadi.vertcat(casadi.sumsqr(x[:4]), *depths), "p": casadi.vec(uv)}
    options = {"print_time": False, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-12}
    return casadi.nlpsol("pose", "ipopt", problem, options)


solver = make_ipopt()


def ipopt(pixels, _):
    # A level remote before the beacon: nothing of the pose is given away.
    start = [0, 1, 0, 0, 0, 0, 15]
    before = [0.1] * len(leds)  # of the camera, in units of 100 mm
    found = solver(x0=start, p=pixels.ravel(), lbg=[1] + before, ubg=[1] + [np.inf] * len(leds))
    x = np.array(found["x"]).ravel()
    w, a, b, c = x[:4]
    r = cv2.Rodrigues(2 * np.arctan2(np.linalg.norm(x[1:4]), w) * x[1:4] / np.linalg.norm(x[1:4]))[0]
    return r, x[4:7] * 100


report = {}
for name, solve in [("opencv", opencv), ("poselib", by_poselib), ("ipopt", ipopt)]:
    degrees, mm, better, worse, times = 0.0, 0.0, 0, 0, []
    for view in work["views"]:
        pixels = np.array(view["pixels"])
        R0 = np.array(view["pose"]["rotation"]).reshape(3, 3)
        t0 = np.array(view["pose"]["translation_mm"])
        start = time.perf_counter()
        R, t = solve(pixels, view)
        times.append((time.perf_counter() - start) * 1e6)
        ours, theirs = cost(R0, t0, pixels), cost(R, t, pixels)
        better += theirs < ours - 1e-6
        if theirs > ours + 1e-6:
            worse += 1
            continue
        sine = np.linalg.norm(R @ R0.T - R0 @ R.T) / np.sqrt(8)
        degrees = max(degrees, float(np.degrees(np.arcsin(min(1.0, sine)))))
        mm = max(mm, float(np.linalg.norm(t - t0)))
    report[name] = {
        "views": len(work["views"]),
        "max_degrees": degrees,
        "max_mm": mm,
        "better": int(better),
        "worse": int(worse),
        "median_us": float(np.median(times)),
    }
print(json.dumps(report, indent=1))
