# Unpacks the samples from downloaded packages; see scripts/setup-samples.
#
# usage: unpack.py DOWNLOADS SAMPLES
"""SAMPLES receives one folder per series, `quirks` with single DICOM files, `interop` with files of other programs, and `volumes`
with NIfTI. Only the members named here are read. They are written into these folders, whatever their paths in the package.
"""

import io
import pathlib
import sys
import tarfile
import zipfile

downloads, samples = map(pathlib.Path, sys.argv[1:])
REFERENCE = "tests/reference_files/"
#: Names of single DICOM files in pydicom and pydicom-data.
QUIRKS = """CT_small no_meta no_meta_group_length meta_missing_tsyntax ExplVR_BigEnd ExplVR_BigEndNoMeta ExplVR_LitEndNoMeta
image_dfl MR_truncated MR_small_padded MR_small_bigendian JPEG2000-embedded-sequence-delimiter UN_sequence badVR empty_charset_LEI
nested_priv_SQ emri_small_RLE emri_small_jpeg_2k_lossless_too_short liver SC_rgb SC_rgb_small_odd MR2_J2KI
rtdose rtstruct test-SR J2K_pixelrep_mismatch explicit_VR-UN bad_sequence eCT_Supplemental""".split()


def put(path, content):
    path = samples / path
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content)


def package(pattern):
    found = list(downloads.glob(pattern))
    if len(found) != 1:
        raise SystemExit(f"{len(found)} files {pattern} were downloaded, expected one")
    return found[0]


def phantom():
    with zipfile.ZipFile(package("pylinac-*.whl")) as wheel:
        demo = wheel.read("pylinac/demo_files/cbct/High quality head.zip")
    with zipfile.ZipFile(io.BytesIO(demo)) as series:
        for name in series.namelist():
            if name.endswith(".dcm"):
                file = pathlib.PurePosixPath(name).name
                folder = "catphan504-cbct/rtstruct" if file.startswith("RS.") else "catphan504-cbct"
                put(f"{folder}/{file}", series.read(name))


def abdomen():
    whole = {"example_ct_sm.nii.gz": "volumes/totalseg_example_ct_sm.nii.gz", "example_seg.nii.gz": "volumes/totalseg_example_seg.nii.gz",
             "example_seg_dicom.nii.gz": "interop/nifti/totalseg-abdomen-j2k_labels.nii.gz"}
    with tarfile.open(package("totalsegmentator-*.tar.gz")) as sources:
        for member in sources:
            name = member.name.partition("/")[2]
            if not member.isfile() or not name.startswith(REFERENCE):
                continue
            name = name[len(REFERENCE):]
            if name.startswith("example_ct_dicom/"):
                put(f"totalseg-abdomen-j2k/{pathlib.PurePosixPath(name).name}", sources.extractfile(member).read())
            elif name in whole:
                put(whole[name], sources.extractfile(member).read())


def quirks():
    wanted = {f"{name}.dcm" for name in QUIRKS}
    for pattern, folder in [("pydicom-[0-9]*.whl", "pydicom/data/test_files/"), ("pydicom_data-*.whl", "data_store/data/")]:
        with zipfile.ZipFile(package(pattern)) as wheel:
            for name in wheel.namelist():
                if not name.startswith(folder) or name.endswith("/"):
                    continue
                name = name[len(folder):]
                if name in wanted:
                    put(f"quirks/{name}", wheel.read(folder + name))
                elif name == "RG3_J2KI.dcm":
                    put("quirks/RG3_J2KI_MONOCHROME1.dcm", wheel.read(folder + name))
                elif name.startswith("dicomdirtests/77654033/CT2/"):
                    put(f"quirks/dicomdirtests/77654033_CT2/{pathlib.PurePosixPath(name).name}", wheel.read(folder + name))
                elif name == "dicomdirtests/DICOMDIR":
                    put("quirks/DICOMDIR", wheel.read(folder + name))


def slicer():
    with zipfile.ZipFile(package("slicerio-*.whl")) as wheel:
        for name in ["CTChest4.nrrd", "F_1.fcsv", "Segmentation.seg.nrrd", "SegmentationOverlapping.seg.nrrd"]:
            put(f"interop/slicer/{name}", wheel.read(f"slicerio/data/{name}"))


phantom()
abdomen()
quirks()
slicer()
