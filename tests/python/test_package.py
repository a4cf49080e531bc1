"""The Python package as its users call it, against the command line, NumPy, SimpleITK and nibabel.

usage: test_package.py    with the package and its peers on the path, RELIEF_PROGRAM the command line, RELIEF_DOCS the folder docs
"""

import io
import json
import os
import pathlib
import re
import socket
import struct
import subprocess
import tempfile
import threading
import time
import tracemalloc
import unittest

import nibabel
import numpy
import SimpleITK
from PIL import Image

import relief

PROGRAM = os.environ["RELIEF_PROGRAM"]
DOCS = pathlib.Path(os.environ["RELIEF_DOCS"])


def command(*arguments):
    """Runs the command line; gives what it prints."""
    environment = dict(os.environ, RELIEF_ADAPTER="cpu")
    return subprocess.run([PROGRAM, *map(str, arguments)], check=True, capture_output=True, text=True, env=environment).stdout


class Series(unittest.TestCase):
    """A folder with a series on disk, made by the command line."""

    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.path = pathlib.Path(cls.folder.name)
        cls.series = cls.path / "head"
        command("phantom", "--kind", "head", "--size", 48, "--out", cls.series)
        cls.volume = relief.open(cls.series)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()


class Archives(Series):
    """Series of an Orthanc on loopback."""

    def test_a_series_of_an_archive_is_that_of_its_files(self):
        programs = os.environ.get("RELIEF_ORTHANC")
        if not programs:
            print("SKIPPED: series of archives in Python (RELIEF_ORTHANC is not set)", flush=True)
            return
        with socket.socket() as one, socket.socket() as two:
            one.bind(("127.0.0.1", 0)), two.bind(("127.0.0.1", 0))
            web, dicom = one.getsockname()[1], two.getsockname()[1]
        store = self.path / "store"
        settings = self.path / "orthanc.json"
        settings.write_text(json.dumps({
            "StorageDirectory": str(store), "IndexDirectory": str(store), "HttpPort": web, "DicomPort": dicom, "DicomAet": "ORTHANC",
            "DicomAlwaysAllowStore": True, "AuthenticationEnabled": True, "RegisteredUsers": {"reader": "a secret"}, "Plugins": [f"{programs}/dicomweb.so"],
        }))
        login = self.path / "login"
        login.write_text("reader:a secret\n")
        with open(self.path / "orthanc.log", "wb") as log:
            orthanc = subprocess.Popen([f"{programs}/Orthanc", settings], stdout=log, stderr=log)
        self.addCleanup(orthanc.wait)
        self.addCleanup(orthanc.kill)
        for _ in range(300):
            if b"Orthanc has started" in (self.path / "orthanc.log").read_bytes():
                break
            time.sleep(0.1)
        storing = [f"{programs}/storescu", "-aec", "ORTHANC", "127.0.0.1", str(dicom), "+sd", "+r", "+sp", "*.dcm", self.series]
        subprocess.run(storing, check=True, capture_output=True)
        address = f"dicomweb+http://127.0.0.1:{web}/dicom-web?Modality=CT"
        for options in [{"archive_login_file": login}, {"archive_login_file": login, "cache": self.path / "copies"}]:
            volume = relief.open(address, **options)
            self.assertEqual(volume.id, self.volume.id)
        self.assertTrue(list((self.path / "copies").rglob("*.dcm")))
        with self.assertRaisesRegex(relief.ReliefError, "refuses access"):
            relief.open(address)
        with self.assertRaisesRegex(relief.ReliefError, "exclude each other"):
            relief.open(address, archive_login_file=login, archive_token_file=login)
        self.assertEqual(relief.open(self.series, archive_login_file="nowhere").id, self.volume.id)


class Volumes(Series):
    def test_a_series_is_read_as_simpleitk_reads_it(self):
        names = SimpleITK.ImageSeriesReader.GetGDCMSeriesFileNames(str(self.series))
        image = SimpleITK.ReadImage(names)
        self.assertTrue((self.volume.to_array() == SimpleITK.GetArrayFromImage(image)).all())
        for found, expected in [
            (self.volume.spacing, image.GetSpacing()),
            (self.volume.origin, image.GetOrigin()),
            (self.volume.direction.ravel(), image.GetDirection()),
        ]:
            numpy.testing.assert_allclose(found, expected, atol=1e-6)
        again = relief.Volume.from_sitk(image)
        self.assertEqual(again.shape, self.volume.shape)
        self.assertEqual(again.hu(3, 20, 30), int(image[30, 20, 3]))

    def test_an_oblique_image_of_nibabel_lies_where_it_lies_in_patient_space(self):
        array = numpy.arange(4 * 5 * 6, dtype=numpy.int16).reshape(4, 5, 6)
        turn = numpy.array([[0.8, -0.6, 0.0], [0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
        affine = numpy.eye(4)
        affine[:3, :3] = turn @ numpy.diag([0.5, 0.7, 2.0])
        affine[:3, 3] = [10.0, -20.0, 30.0]
        volume = relief.Volume.from_nibabel(nibabel.Nifti1Image(array, affine))
        self.assertEqual((volume.shape, volume.hu(5, 4, 3)), ((6, 5, 4), int(array[3, 4, 5])))
        index = numpy.array([3, 4, 5])
        ras = affine[:3, :3] @ index + affine[:3, 3]
        lps = volume.direction @ (index * volume.spacing) + volume.origin
        numpy.testing.assert_allclose(lps, ras * [-1.0, -1.0, 1.0], atol=1e-9)

    def test_an_array_keeps_its_values_whatever_its_order_and_type(self):
        array = numpy.random.default_rng(1).integers(-1000, 3000, (7, 6, 5))
        for made in [array, array.astype(numpy.float32) + 0.2, numpy.asfortranarray(array.astype(numpy.int16))]:
            volume = relief.Volume.from_array(made, spacing=(0.5, 0.6, 0.7), origin=(1, 2, 3))
            self.assertTrue((volume.to_array() == array).all())
        numpy.testing.assert_allclose(volume.spacing, (0.5, 0.6, 0.7))
        self.assertEqual((volume.origin, volume.range_hu), ((1.0, 2.0, 3.0), (array.min(), array.max())))
        self.assertEqual(relief.Volume.from_array([[[1e6, -1e6]]]).range_hu, (-32768, 32767))

    def test_errors_are_exceptions_with_the_texts_of_the_command_line(self):
        for wrong, text in [
            (lambda: relief.open(self.path / "none"), "none"),
            (lambda: relief.Volume.from_array(numpy.zeros((3, 3))), "has 2 axes, expected 3"),
            (lambda: relief.Volume.from_array([[[float("nan")]]]), "not finite"),
            (lambda: relief.Volume.from_array(numpy.zeros((2, 2, 2)), direction=numpy.zeros(9)), "axes"),
            (lambda: self.volume.render(preset="bonne"), "bonne"),
            (lambda: self.volume.render({"mood": 1}), "unknown field `mood`"),
            (lambda: self.volume.render(azimuth_deg=float("nan")), "azimuth_deg"),
            (lambda: self.volume.render(adapter="cpu").encode("hologram"), 'no layout "hologram"'),
            (lambda: relief.phantom("leg"), "known phantoms: head"),
        ]:
            with self.assertRaises(relief.ReliefError) as raised:
                wrong()
            self.assertIn(text, str(raised.exception))
        self.assertTrue(issubclass(relief.ReliefError, ValueError))
        with self.assertRaises(IndexError):
            self.volume.hu(1000, 0, 0)


class Frames(Series):
    def test_a_picture_is_that_of_the_command_line(self):
        options = {"preset": "bone", "azimuth_deg": 30.0, "elevation_deg": 10.0, "zoom": 1.2, "size": (160, 90)}
        frame = self.volume.render(**options, adapter="cpu")
        self.assertEqual((frame.color.shape, frame.color.dtype), ((90, 160, 4), numpy.uint8))
        self.assertEqual((frame.depth_mm.shape, frame.depth_mm.dtype), ((90, 160), numpy.float32))
        view = ["--series", self.series, "--preset", "bone", "--azimuth-deg", 30, "--elevation-deg", 10, "--zoom", 1.2]
        for layout, size in [("rgbd", "160x90"), ("color", "160x90"), ("lines", "160x90")]:
            command("render", *view, "--layout", layout, "--size", size, "--out", self.path / "frame.png")
            expected = numpy.asarray(Image.open(self.path / "frame.png"))
            found = numpy.asarray(Image.open(io.BytesIO(frame.encode(layout))))
            self.assertTrue((found == expected).all(), layout)
        self.assertTrue((numpy.asarray(Image.open(io.BytesIO(frame._repr_png_()))) == frame.color[..., :3]).all())
        near, far = frame.limits_mm
        hit = numpy.isfinite(frame.depth_mm)
        self.assertTrue(0 < near < far and hit.any() and not hit.all())
        wowvx = self.volume.render(preset="bone", layout="wowvx", size=(960, 540), adapter="cpu")
        wowvx.save(self.path / "frame.png", "wowvx")
        report = json.loads(command("inspect", self.path / "frame.png", "--json"))
        self.assertEqual((report["layout"], report["problems"]), ("wowvx", []))

    def test_picks_and_cameras_are_in_patient_space(self):
        sphere = relief.phantom("sphere", 64)
        camera = {"eye_mm": [0, -900, 0], "look_at_mm": [0, 0, 0], "up": [0, 0, 1]}
        frame = sphere.render(preset="bone", camera=camera, size=(101, 101), adapter="cpu")
        x, y, z = frame.pick(50, 50)
        # A ball of 80 mm around the origin, in voxels of 4 mm.
        numpy.testing.assert_allclose([x, y, z], [0, -80, 0], atol=3)
        self.assertIsNone(frame.pick(0, 0))
        with self.assertRaises(relief.ReliefError):
            frame.pick(101, 0)

    def test_arrays_are_the_picture(self):
        frame = self.volume.render(preset="bone", size=(64, 48), adapter="cpu")
        frame.color[:] = [1, 2, 3, 255]
        picture = numpy.asarray(Image.open(io.BytesIO(frame.encode("color"))))
        self.assertTrue((picture == [1, 2, 3]).all())

    def test_slices_have_the_window_that_is_asked_for(self):
        frame = self.volume.slice("axial", window_hu=(0, 2000), size=(64, 64), adapter="cpu")
        command(
            "render", "--series", self.series, "--plane", "axial", "--window-hu", "0,2000", "--layout", "color", "--size", "64x64",
            "--out", self.path / "slice.png",
        )
        expected = numpy.asarray(Image.open(self.path / "slice.png"))
        self.assertTrue((frame.color[..., :3] == expected).all())

    def test_the_lock_of_the_interpreter_is_released(self):
        counted, done = [0], threading.Event()

        def count():
            while not done.is_set():
                counted[0] += 1
                time.sleep(0.001)

        thread = threading.Thread(target=count)
        thread.start()
        before = counted[0]
        for _ in range(5):
            self.volume.render(preset="skin-and-bone", size=(320, 240), adapter="cpu")
        during = counted[0] - before
        done.set()
        thread.join()
        self.assertGreater(during, 5)

    def test_a_thousand_frames_take_no_memory(self):
        def resident():
            return int(pathlib.Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")

        def frames(count):
            for number in range(count):
                self.volume.render(preset="bone", azimuth_deg=number % 360, size=(64, 48), adapter="cpu").encode("rgbd")

        frames(100)
        tracemalloc.start()
        before = resident()
        frames(1000)
        self.assertLess(resident() - before, 16 << 20)


class Viewers(Series):
    """Live views without a browser: two frames arrive before an acknowledgement is due."""

    def viewer(self, **options):
        viewer = relief.Viewer(self.volume, size=(64, 48), adapter="cpu", **options)
        self.addCleanup(viewer.close)
        for _ in range(200):
            if viewer.camera:
                return viewer
            time.sleep(0.05)
        self.fail("no frame arrives")

    def test_a_picture_of_the_view_has_all_that_was_set(self):
        viewer = self.viewer(preset="skin", scene={"shading": {"ambient": 0.5}})
        cut = {"clip": {"planes": [{"point_mm": [0, 0, 0], "normal": [0, 1, 0]}]}}

        def expected(scene, preset):
            return self.volume.render(scene, preset=preset, camera=viewer.camera, size=(64, 48), adapter="cpu").color

        for change, scene in [
            (None, {"shading": {"ambient": 0.5}}), (cut, {"shading": {"ambient": 0.5}, **cut}), ({"clip": None}, {"shading": {"ambient": 0.5}}),
        ]:
            if change:
                viewer.change(change)
            self.assertTrue((viewer.render(adapter="cpu").color == expected(scene, "skin")).all(), scene)
        self.assertFalse((expected(cut, "skin") == expected({}, "skin")).all())
        viewer.preset = "bone"
        self.assertTrue((viewer.render(adapter="cpu").color == expected({}, "bone")).all(), "a preset brings its own light")
        points = [{"hu": 0, "rgba": [0, 0, 0, 0]}, {"hu": 60, "rgba": [1, 1, 1, 1]}]
        viewer.change({"transfer": {"points": points}})
        self.assertIsNone(viewer.preset)
        self.assertTrue((viewer.render(adapter="cpu").color == expected({"transfer": {"points": points}}, None)).all())

    def test_a_frame_that_the_browser_lost_is_sent_again(self):
        viewer = self.viewer()
        sent = []
        viewer.send = lambda content, buffers=None: sent.append((content["type"], struct.unpack_from("<I", buffers[0], 12)[0]))

        def heard(frame):
            viewer._heard(viewer, {"type": "ack", "frame": frame, "t_ns": time.monotonic_ns()}, [])

        def settle():
            for _ in range(100):
                before = len(sent)
                time.sleep(1.5)
                if sent and len(sent) == before:
                    return
            self.fail("the frames do not end")

        settle()
        kinds, numbers = {kind for kind, _ in sent}, [number for _, number in sent]
        self.assertEqual(kinds, {"frame"})
        self.assertEqual(numbers[-3:], [numbers[-1]] * 3, "a frame without an acknowledgement is sent again, three times")
        sent.clear()
        heard(numbers[-1])
        viewer.look(azimuth_deg=30)
        settle()
        self.assertGreater(sent[-1][1], numbers[-1], "an acknowledgement lets the next frames come")
        heard(sent[-1][1])
        settle()
        last = sent[-1][1]
        heard(last)
        sent.clear()
        time.sleep(2)
        self.assertEqual(sent, [], "an acknowledged frame is not sent again")

    def test_invalid_settings_are_errors(self):
        for options, text in [({"preset": "bonne"}, "bonne"), ({"scene": {"mood": 1}}, "mood")]:
            with self.assertRaises(relief.ReliefError) as raised:
                relief.Viewer(self.volume, **options)
            self.assertIn(text, str(raised.exception))


class Annotations(Series):
    def test_landmarks_of_slicer_become_dataclasses_and_a_table_and_a_file_again(self):
        points = [{"label": name, "position": [i, 2.0 * i, -i]} for i, name in enumerate(["nasion", "basion"], 1)]
        schema = "https://raw.githubusercontent.com/slicer/slicer/master/Modules/Loadable/Markups/Resources/Schema/markups-schema-v1.0.3.json#"
        markups = {"@schema": schema, "markups": [{"type": "Fiducial", "coordinateSystem": "LPS", "controlPoints": points}]}
        path = self.path / "landmarks.mrk.json"
        path.write_text(json.dumps(markups))
        found = relief.read_annotations(path)
        self.assertEqual([(one.name, one.kind, one.position_mm) for one in found], [
            ("nasion", "point", (1.0, 2.0, -1.0)), ("basion", "point", (2.0, 4.0, -2.0)),
        ])
        table = relief.annotations_table(found)
        self.assertEqual(list(table["x_mm"]), [1.0, 2.0])
        new = relief.Annotation.point("inion", (3, 4, 5), author="anna")
        relief.write_annotations([new], self.path / "new.fcsv", "fcsv")
        self.assertEqual(relief.read_annotations(self.path / "new.fcsv")[0].position_mm, (3.0, 4.0, 5.0))
        many = [relief.Annotation.point(name, (0, 0, 0), author="anna") for name in "zyxwvuabc"]
        relief.write_annotations(many, self.path / "many.mrk.json", "mrk.json")
        self.assertEqual("".join(one.name for one in relief.read_annotations(self.path / "many.mrk.json")), "zyxwvuabc")
        relief.write_annotations(found, self.path / "again.csv", "csv")
        again = relief.read_annotations(self.path / "again.csv")
        self.assertEqual([one.position_mm for one in again], [one.position_mm for one in found])
        with self.assertRaises(relief.ReliefError):
            relief.read_annotations(self.series / "none.mrk.json")


class Documents(Series):
    def test_the_examples_of_the_documents_run(self):
        text = (DOCS / "PYTHON.md").read_text(encoding="utf-8")
        blocks = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
        self.assertGreater(len(blocks), 3)
        before = os.getcwd()
        os.chdir(self.path)
        try:
            scope = {}
            for block in blocks:
                exec(compile(block, "docs/PYTHON.md", "exec"), scope)
        finally:
            os.chdir(before)


if __name__ == "__main__":
    unittest.main(verbosity=2)
