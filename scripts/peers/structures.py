# Times SimpleITK and VTK on the volumes of compare-structures.
"""Times SimpleITK's region growing and VTK's surfaces on the volumes of a folder that `cargo bench -p relief-bench --bench structures -- --keep`
wrote, and tells what they found: one JSON object.

usage: structures.py FOLDER [THREADS]

Reading and making arrays is not timed, making VTK's input from an array is not either. Surface nets run without smoothing.
"""
import hashlib
import json
import pathlib
import statistics
import sys
import time

import numpy as np
import SimpleITK as sitk
import vtk
from vtk.util.numpy_support import numpy_to_vtk

folder = pathlib.Path(sys.argv[1])
threads = int(sys.argv[2]) if len(sys.argv) > 2 else 2
REPEAT = 3
sitk.ProcessObject.SetGlobalDefaultNumberOfThreads(threads)
vtk.vtkSMPTools.Initialize(threads)


def timed(run):
    times, result = [], None
    for _ in range(REPEAT):
        start = time.perf_counter()
        result = run()
        times.append(time.perf_counter() - start)
    return statistics.median(times), result


def surface(make, image):
    def run():
        found = make()
        found.SetInputData(image)
        found.Update()
        return found.GetOutput()

    seconds, mesh = timed(run)
    return {"s": seconds, "triangles": mesh.GetNumberOfPolys(), "points": mesh.GetNumberOfPoints()}


def flying_edges():
    found = vtk.vtkDiscreteFlyingEdges3D()
    found.SetValue(0, 1)
    found.ComputeNormalsOff()
    found.ComputeGradientsOff()
    found.ComputeScalarsOff()
    return found


def surface_nets():
    found = vtk.vtkSurfaceNets3D()
    found.SetValue(0, 1)
    found.SmoothingOff()
    found.SetOutputMeshTypeToTriangles()
    return found


reports = {}
for described in sorted(folder.glob("*.json")):
    facts = json.loads(described.read_text())
    if "seed" not in facts:
        continue
    nx, ny, nz = facts["dims"]
    values = np.fromfile(described.with_suffix(".raw"), dtype="<i2").reshape(nz, ny, nx)
    image = sitk.GetImageFromArray(values)
    image.SetSpacing(facts["spacing_mm"])
    low, high = facts["hu"]
    grow_s, mask = timed(lambda: sitk.ConnectedThreshold(image, [facts["seed"]], low, high, 1))
    array = np.ascontiguousarray(sitk.GetArrayViewFromImage(mask))
    grid = vtk.vtkImageData()
    grid.SetDimensions(nx, ny, nz)
    grid.SetSpacing(facts["spacing_mm"])
    grid.GetPointData().SetScalars(numpy_to_vtk(array.ravel(), deep=False))
    reports[facts["name"]] = {
        "grow_s": grow_s,
        "voxels": int(array.sum()),
        "mask_sha256": hashlib.sha256(array.tobytes()).hexdigest(),
        "flying_edges": surface(flying_edges, grid),
        "surface_nets": surface(surface_nets, grid),
    }
print(json.dumps({"simpleitk": sitk.Version_VersionString(), "vtk": vtk.vtkVersion.GetVTKVersion(), "inputs": reports}))
