# Renders scenes of every mode with VTK and compares pictures.
"""Renders scenes of every mode with VTK's GPU volume mapper, and measures how far two pictures are apart.

usage: vtk_modes.py render --series DIR SCENE.json OUT.png [SCENE.json OUT.png ...]
       vtk_modes.py compare A.png B.png

A scene is Relief's: camera, size_px, mode, transfer.points, shading, sample_distance_mm, clip.box_mm, background_rgb,
and for isosurfaces iso_hu or surfaces. The mode mean has no counterpart in VTK: it is drawn as average with an opacity of
1, whose grey is the mean value between the volume's smallest and largest. Surfaces become iso values; their colours and
opacities go into the transfer function around each value, which VTK looks up there. VTK finds a surface at the first
sample behind it and takes the gradient there, not at the surface: compare at a small sample distance.

compare prints {"mean_abs", "p99", "covered_px"} as JSON: the absolute difference of channels, of 255, over the pixels of
which either picture has a channel above 8.

Needs vtk, SimpleITK, numpy and pillow; draws without a window, by OSMesa.
"""
import argparse
import json
import sys

import numpy as np
from PIL import Image

# Half the width in HU of the step of the transfer function around an iso value.
STEP_HU = 2.0


def compare(first, second):
    a, b = (np.asarray(Image.open(path).convert("RGB"), dtype=np.int16) for path in (first, second))
    if a.shape != b.shape:
        sys.exit(f"sizes differ: {a.shape} and {b.shape}")
    covered = np.maximum(a.max(axis=2), b.max(axis=2)) > 8
    if not covered.any():
        sys.exit("no pixel is covered: there is nothing to compare")
    apart = np.abs(a - b)[covered]
    result = {"mean_abs": round(float(apart.mean()), 3), "p99": float(np.percentile(apart, 99)),
              "covered_px": int(covered.sum())}
    print(json.dumps(result))


def read_series(folder):
    """The largest series of a folder: its values, and where they lie in patient space (LPS, mm)."""
    import SimpleITK as sitk
    reader = sitk.ImageSeriesReader()
    series = [reader.GetGDCMSeriesFileNames(folder, uid) for uid in reader.GetGDCMSeriesIDs(folder)]
    if not series:
        sys.exit(f"there is no DICOM series in {folder}")
    reader.SetFileNames(max(series, key=len))
    image = reader.Execute()
    values = sitk.GetArrayFromImage(image).astype(np.int16)
    placed = np.eye(4)
    placed[:3, :3] = np.reshape(image.GetDirection(), (3, 3))
    placed[:3, 3] = image.GetOrigin()
    return values, image.GetSpacing(), placed


def image_data(vtk, values, spacing):
    from vtk.util.numpy_support import numpy_to_vtk
    data = vtk.vtkImageData()
    data.SetDimensions(*values.shape[::-1])
    data.SetSpacing(*spacing)
    data.GetPointData().SetScalars(numpy_to_vtk(values.ravel(), deep=True, array_type=vtk.VTK_SHORT))
    return data


def surfaces_of(scene):
    """HU, colour and opacity of each surface; the colour is the transfer function's where none is given."""
    given = scene.get("surfaces") or [{"hu": scene["iso_hu"]}]
    points = scene["transfer"]["points"]
    at = [point["hu"] for point in points]
    for surface in sorted(given, key=lambda surface: surface["hu"]):
        default = [np.interp(surface["hu"], at, [point["rgba"][c] for point in points]) for c in range(3)]
        yield surface["hu"], surface.get("rgb", default), surface.get("opacity", 1.0)


def looks(vtk, scene):
    """Colour and opacity by value, light, and iso values."""
    color, opacity, look = vtk.vtkColorTransferFunction(), vtk.vtkPiecewiseFunction(), vtk.vtkVolumeProperty()
    if scene["mode"] == "isosurface":
        surfaces = list(surfaces_of(scene))
        # There is one to begin with, at 0.
        look.GetIsoSurfaceValues().SetNumberOfContours(len(surfaces))
        for i, (hu, rgb, alpha) in enumerate(surfaces):
            look.GetIsoSurfaceValues().SetValue(i, hu)
            for side in (-STEP_HU, STEP_HU):
                color.AddRGBPoint(hu + side, *rgb)
                opacity.AddPoint(hu + side, alpha)
    else:
        for point in scene["transfer"]["points"]:
            color.AddRGBPoint(point["hu"], *point["rgba"][:3])
            opacity.AddPoint(point["hu"], 1.0 if scene["mode"] == "mean" else point["rgba"][3])
    look.SetColor(color)
    look.SetScalarOpacity(opacity)
    look.SetScalarOpacityUnitDistance(scene["transfer"].get("opacity_unit_mm", 1.0))
    look.SetInterpolationTypeToLinear()
    light = scene.get("shading")
    if light and scene["mode"] in ("composite", "isosurface"):
        look.ShadeOn()
        look.SetAmbient(light["ambient"])
        look.SetDiffuse(light["diffuse"])
        look.SetSpecular(light.get("specular", 0.0))
        look.SetSpecularPower(light.get("shininess", 10.0))
    return look


def mapper_of(vtk, scene, data):
    mapper = vtk.vtkOpenGLGPUVolumeRayCastMapper()
    mapper.SetInputData(data)
    mapper.SetUseJittering(False)
    mapper.SetAutoAdjustSampleDistances(False)
    mapper.SetSampleDistance(scene["sample_distance_mm"])
    {"composite": mapper.SetBlendModeToComposite, "mip": mapper.SetBlendModeToMaximumIntensity,
     "minip": mapper.SetBlendModeToMinimumIntensity, "mean": mapper.SetBlendModeToAverageIntensity,
     "average": mapper.SetBlendModeToAverageIntensity, "additive": mapper.SetBlendModeToAdditive,
     "isosurface": mapper.SetBlendModeToIsoSurface}[scene["mode"]]()
    corners = (scene.get("clip") or {}).get("box_mm")
    for corner, inwards in zip(corners or [], (1.0, -1.0)):
        for axis in range(3):
            plane = vtk.vtkPlane()
            plane.SetOrigin(*corner)
            plane.SetNormal(*(inwards if i == axis else 0.0 for i in range(3)))
            mapper.AddClippingPlane(plane)
    return mapper


def aim(camera, scene):
    placed = scene["camera"]
    camera.SetPosition(*placed["eye_mm"])
    camera.SetFocalPoint(*placed["look_at_mm"])
    camera.SetViewUp(*placed.get("up", (0, 0, 1)))
    projection = placed["projection"]
    if "orthographic" in projection:
        camera.ParallelProjectionOn()
        camera.SetParallelScale(projection["orthographic"]["height_mm"] / 2)
    else:
        camera.SetViewAngle(projection["perspective"]["vertical_fov_deg"])


def render(vtk, series, data, placed, scene):
    from vtk.util.numpy_support import vtk_to_numpy
    volume = vtk.vtkVolume()
    volume.SetMapper(mapper_of(vtk, scene, data))
    volume.SetProperty(looks(vtk, scene))
    matrix = vtk.vtkMatrix4x4()
    matrix.DeepCopy(placed.ravel())
    volume.SetUserMatrix(matrix)
    renderer, window = vtk.vtkRenderer(), vtk.vtkRenderWindow()
    renderer.SetBackground(*scene.get("background_rgb", (0, 0, 0)))
    renderer.AddVolume(volume)
    window.SetOffScreenRendering(True)
    window.SetMultiSamples(0)
    window.SetSize(*scene["size_px"])
    window.AddRenderer(renderer)
    aim(renderer.GetActiveCamera(), scene)
    renderer.ResetCameraClippingRange()
    window.Render()
    shot = vtk.vtkWindowToImageFilter()
    shot.SetInput(window)
    shot.ReadFrontBufferOff()
    shot.Update()
    width, height = scene["size_px"]
    pixels = vtk_to_numpy(shot.GetOutput().GetPointData().GetScalars())
    # VTK's rows go from the bottom up.
    return pixels.reshape(height, width, 3)[::-1]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    rendering = commands.add_parser("render")
    rendering.add_argument("--series", required=True)
    rendering.add_argument("files", nargs="+")
    comparing = commands.add_parser("compare")
    comparing.add_argument("pictures", nargs=2)
    arguments = parser.parse_args()
    if arguments.command == "compare":
        return compare(*arguments.pictures)
    if len(arguments.files) % 2:
        parser.error("scenes and pictures come in pairs")
    import vtk
    values, spacing, placed = read_series(arguments.series)
    data = image_data(vtk, values, spacing)
    for scene_file, picture in zip(arguments.files[::2], arguments.files[1::2]):
        with open(scene_file, encoding="utf-8") as file:
            scene = json.load(file)
        Image.fromarray(render(vtk, arguments.series, data, placed, scene)).save(picture)


if __name__ == "__main__":
    main()
