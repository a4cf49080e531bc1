"""The notebooks of docs/notebooks, executed as JupyterLab executes them.

usage: test_notebooks.py    with the package and its peers on the path, RELIEF_DOCS the folder docs
"""

import base64
import io
import os
import pathlib
import tempfile
import unittest

import nbclient
import nbformat
import numpy
from PIL import Image

NOTEBOOKS = pathlib.Path(os.environ["RELIEF_DOCS"]) / "notebooks"


class Notebooks(unittest.TestCase):
    def executed(self, name):
        """The pictures and the texts of a notebook's outputs."""
        notebook = nbformat.read(NOTEBOOKS / name, as_version=4)
        nbformat.validate(notebook)
        for cell in notebook.cells:
            self.assertFalse(cell.get("outputs"), f"{name} is committed with outputs; clear them")
        with tempfile.TemporaryDirectory() as folder:
            nbclient.NotebookClient(notebook, timeout=120, resources={"metadata": {"path": folder}}).execute()
            files = sorted(path.name for path in pathlib.Path(folder).iterdir())
        outputs = [output for cell in notebook.cells for output in cell.get("outputs", [])]
        self.assertFalse([output for output in outputs if output.get("name") == "stderr"])
        data = [output.data for output in outputs if "data" in output]
        pictures = [Image.open(io.BytesIO(base64.b64decode(one["image/png"]))) for one in data if "image/png" in one]
        return pictures, data, files

    def test_pictures(self):
        pictures, _, files = self.executed("pictures.ipynb")
        sizes = [picture.size for picture in pictures]
        self.assertEqual((sizes[0], sizes[2:], len(sizes)), ((640, 480), [(640, 480), (320, 320)], 4))
        for picture in pictures:
            self.assertGreater(len(numpy.unique(numpy.asarray(picture.convert("L")))), 50, "a picture shows nothing")
        self.assertEqual(files, ["wowvx.png"])

    def test_landmarks(self):
        _, data, files = self.executed("landmarks.ipynb")
        self.assertTrue(any("application/vnd.jupyter.widget-view+json" in one for one in data))
        self.assertTrue(any("left of here" in one.get("text/html", "") for one in data))
        self.assertEqual(files, ["landmarks.mrk.json"])

    def test_all_are_here(self):
        self.assertEqual({path.name for path in NOTEBOOKS.glob("*.ipynb")}, {"pictures.ipynb", "landmarks.ipynb"})


if __name__ == "__main__":
    unittest.main(verbosity=2)
