# Renders N views of every series below a folder with PyVista, as a script of a researcher would.
"""Render N views of every series below a folder with PyVista, off screen, as a researcher's script would.

usage: pyvista_batch.py ROOT OUT VIEWS WIDTH HEIGHT PRESETS.json PRESET [gpu|smart]

One PNG a view: composite volume rendering with shading, a turntable from the front, samples of 1 mm, in the colours, opacities and
light of a preset as `relief presets --json` prints them. Prints the views and the seconds as JSON. The volume goes to the mapper
once a series.
"""
import json
import math
import os
import sys
import time

import numpy as np
import pyvista
import SimpleITK

root, out, views, width, height = sys.argv[1], sys.argv[2], *map(int, sys.argv[3:6])
with open(sys.argv[6], encoding="utf-8") as file:
    look = next(preset for preset in json.load(file)["presets"] if preset["name"] == sys.argv[7])
mapper = sys.argv[8] if len(sys.argv) > 8 else "gpu"


def dress(prop):
    """Gives a volume's property the preset's transfer function and light."""
    prop.GetRGBTransferFunction(0).RemoveAllPoints()
    prop.GetScalarOpacity(0).RemoveAllPoints()
    for point in look["transfer"]["points"]:
        red, green, blue, opacity = point["rgba"]
        prop.GetRGBTransferFunction(0).AddRGBPoint(point["hu"], red, green, blue)
        prop.GetScalarOpacity(0).AddPoint(point["hu"], opacity)
    prop.SetScalarOpacityUnitDistance(look["transfer"]["opacity_unit_mm"])
    prop.SetInterpolationTypeToLinear()
    light = look["shading"]
    prop.ShadeOn()
    prop.SetAmbient(light["ambient"])
    prop.SetDiffuse(light["diffuse"])
    prop.SetSpecular(light["specular"])
    prop.SetSpecularPower(light["shininess"])


pyvista.OFF_SCREEN = True
os.makedirs(out, exist_ok=True)
started, done = time.time(), 0
for name in sorted(os.listdir(root)):
    folder = os.path.join(root, name)
    reader = SimpleITK.ImageSeriesReader()
    reader.SetFileNames(reader.GetGDCMSeriesFileNames(folder))
    image = reader.Execute()
    hu = SimpleITK.GetArrayFromImage(image).astype(np.int16)
    grid = pyvista.ImageData(dimensions=image.GetSize(), spacing=image.GetSpacing())
    grid.point_data["hu"] = hu.ravel()
    plotter = pyvista.Plotter(off_screen=True, window_size=[width, height], lighting="none")
    plotter.add_light(pyvista.Light(light_type="headlight"))
    plotter.background_color = "black"
    volume = plotter.add_volume(grid, scalars="hu", mapper=mapper, show_scalar_bar=False)
    dress(volume.prop)
    volume.mapper.SetAutoAdjustSampleDistances(0)
    volume.mapper.SetSampleDistance(1.0)
    centre = np.array(grid.center)
    radius = np.linalg.norm(np.array(grid.bounds[1::2]) - np.array(grid.bounds[::2])) / 2
    distance = radius / math.sin(math.radians(11))
    for view in range(views):
        angle = 2 * math.pi * view / views
        eye = centre + distance * np.array([math.sin(angle), -math.cos(angle), 0])
        plotter.camera_position = [eye, centre, (0, 0, 1)]
        plotter.camera.view_angle = 22
        plotter.screenshot(os.path.join(out, f"{name}-{view:03}.png"))
        done += 1
    plotter.close()
print(json.dumps({"views": done, "seconds": time.time() - started}))
