# Computes the expected values of tests from the samples, with libraries of others; see scripts/setup-samples.
#
# usage: facts.py SAMPLES
"""Writes JSON files beside the samples. Positions are patient LPS, mm; arrays are (slice, row, column), slices in ascending
order along their normal.
"""

import hashlib
import json
import pathlib
import sys
import xml.etree.ElementTree as xml

import nibabel
import nrrd
import numpy as np
import pydicom
import SimpleITK

samples = pathlib.Path(sys.argv[1])


def write(name, facts):
    (samples / name).write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")


def vector(values, digits=6):
    return [round(float(value), digits) for value in values]


def sha256(array):
    return hashlib.sha256(np.ascontiguousarray(array, dtype="<i2").tobytes()).hexdigest()


def hu_of(slice_):
    return np.rint(slice_.pixel_array.astype(np.float64) * float(slice_.RescaleSlope) + float(slice_.RescaleIntercept)).astype(np.int16)


def slices_of(folder):
    """The files of a series with their data sets, in ascending order along the normal."""
    read = [(path, pydicom.dcmread(path)) for path in sorted(folder.iterdir()) if path.is_file()]
    along = np.array(read[0][1].ImageOrientationPatient, dtype=float)
    normal = np.cross(along[:3], along[3:])
    return sorted(read, key=lambda item: np.dot(np.array(item[1].ImagePositionPatient, dtype=float), normal))


def by_simpleitk(paths):
    image = SimpleITK.ReadImage([str(path) for path in paths])
    return SimpleITK.GetArrayFromImage(image), {
        "origin": vector(image.GetOrigin()), "spacing": vector(image.GetSpacing()), "direction": vector(image.GetDirection(), 9),
    }


def series(name):
    read = slices_of(samples / name)
    paths, slices = [path for path, _ in read], [slice_ for _, slice_ in read]
    hu = np.stack([hu_of(slice_) for slice_ in slices])
    positions = np.array([slice_.ImagePositionPatient for slice_ in slices], dtype=float)
    along = np.array(slices[0].ImageOrientationPatient, dtype=float)
    row_mm, column_mm = map(float, slices[0].PixelSpacing)
    step = (positions[-1] - positions[0]) / (len(slices) - 1)
    other, simpleitk = by_simpleitk(paths)
    if not np.array_equal(hu, other):
        raise SystemExit(f"{name}: pydicom and SimpleITK read other values")
    # Corners, and places that a fixed generator chooses.
    random = np.random.default_rng(504)
    places = [(0, 0, 0), tuple(side - 1 for side in hu.shape)] + [tuple(random.integers(hu.shape)) for _ in range(18)]
    at = lambda z, y, x: positions[z] + along[:3] * column_mm * x + along[3:] * row_mm * y
    write(f"{name}.facts.json", {
        "series_instance_uid": [str(slices[0].SeriesInstanceUID)],
        "transfer_syntax": [str(slices[0].file_meta.TransferSyntaxUID)],
        "geometry": {
            "shape_zyx": list(hu.shape), "ipp_all_lps": [vector(position, 5) for position in positions],
            "pixel_spacing_row_col_mm": [row_mm, column_mm], "mean_step_length_mm": round(float(np.linalg.norm(step)), 6),
        },
        "hu": {"min": int(hu.min()), "max": int(hu.max()), "mean": round(float(hu.mean()), 6), "sha256_int16le_zyx": sha256(hu)},
        "samples": [{"zyx": [int(n) for n in zyx], "hu": int(hu[zyx]), "lps_mm": vector(at(*zyx), 4)} for zyx in places],
        "simpleitk": simpleitk,
    })


def labels_of(image, values, mean):
    """Voxels, volume, mean value and centroid of every label of a NIfTI image."""
    array = np.asarray(image.dataobj)
    names = named(image)
    voxel_ml = abs(np.linalg.det(image.affine[:3, :3])) / 1e3
    facts = {}
    for label in np.unique(array[array > 0]):
        places = np.argwhere(array == label)
        ras = image.affine[:3, :3] @ places.mean(axis=0) + image.affine[:3, 3]
        facts[str(int(label))] = {
            "name": names.get(int(label)), "n_voxels": len(places), "volume_ml": round(len(places) * voxel_ml, 3),
            mean: round(float(values[array == label].mean()), 2), "centroid_lps": vector((-ras[0], -ras[1], ras[2]), 2),
        }
    return facts


def named(image):
    """Names of labels in the extension of Connectome Workbench."""
    for extension in image.header.extensions:
        text = extension.get_content()
        text = text.decode("utf-8", "ignore") if isinstance(text, bytes) else str(text)
        if "<Label " in text:
            tree = xml.fromstring(text.strip("\0 \n"))
            return {int(label.attrib["Key"]): label.text for label in tree.iter("Label")}
    return {}


def small_abdomen():
    image = nibabel.load(samples / "volumes/totalseg_example_ct_sm.nii.gz")
    values = np.asarray(image.dataobj)
    # x runs fastest in the file, as in memory in the order of Fortran.
    digest = hashlib.sha256(values.astype("<i2").tobytes(order="F")).hexdigest()
    segments = nibabel.load(samples / "volumes/totalseg_example_seg.nii.gz")
    write("volumes.facts.json", [{"sha256_int16le_Fortran_xyz(x fastest)": digest, "labels": labels_of(segments, values, "mean_value")}])


def files_of_others():
    hu = np.stack([hu_of(slice_) for _, slice_ in slices_of(samples / "totalseg-abdomen-j2k")])
    labels = nibabel.load(samples / "interop/nifti/totalseg-abdomen-j2k_labels.nii.gz")
    # The label map's rows run against those of the slices.
    values = hu.transpose(2, 1, 0)[:, ::-1, :]
    segments, header = nrrd.read(str(samples / "interop/slicer/Segmentation.seg.nrrd"))
    counts = {str(int(label)): int(count) for label, count in zip(*np.unique(segments[segments > 0], return_counts=True))}
    write("interop.facts.json", {
        "totalseg-abdomen-j2k_labels": {"labels": labels_of(labels, values, "mean_HU")},
        "slicer_Segmentation.seg.nrrd": {
            "label_counts": counts, "origin": vector(header["space origin"], 12),
            "segments": {key: value for key, value in header.items() if key.startswith("Segment") and key.endswith("_Name")},
        },
    })


def quirks():
    facts = []
    for name in ["CT_small.dcm", "J2K_pixelrep_mismatch.dcm", "explicit_VR-UN.dcm", "bad_sequence.dcm"]:
        try:
            hu = hu_of(pydicom.dcmread(samples / "quirks" / name))
        except (AttributeError, RuntimeError):
            # A compression that this Python has no decoder for.
            hu = by_simpleitk([samples / "quirks" / name])[0]
        facts.append({"file": name, "hu": [int(hu.min()), int(hu.max()), round(float(hu.mean()), 4)]})
    write("quirks.facts.json", facts)


def enhanced():
    slices = pydicom.dcmread(samples / "quirks/eCT_Supplemental.dcm")
    frames = []
    for pixels, groups in zip(slices.pixel_array, slices.PerFrameFunctionalGroupsSequence):
        values = lambda name: getattr(groups, name, None) or getattr(slices.SharedFunctionalGroupsSequence[0], name)
        scale = values("PixelValueTransformationSequence")[0]
        hu = pixels.astype(np.float64) * float(scale.RescaleSlope) + float(scale.RescaleIntercept)
        place = vector(values("PlanePositionSequence")[0].ImagePositionPatient)
        frames.append({"ipp": place, "hu_min_max_mean": [float(hu.min()), float(hu.max()), round(float(hu.mean()), 4)]})
    write("enhanced_ct.facts.json", {"quirks/eCT_Supplemental.dcm": {"frames_facts": frames}})


if __name__ == "__main__":
    for name in ["catphan504-cbct", "totalseg-abdomen-j2k"]:
        series(name)
    enhanced()
    small_abdomen()
    files_of_others()
    quirks()
