# Writes one real slice in several transfer syntaxes, with encoders of others; see scripts/setup-samples.
#
# usage: codecs.py SAMPLES
"""`codecs` receives the files, `codecs.facts.json` the expected values. GDCM (in SimpleITK) encodes JPEG Lossless and JPEG 2000,
CharLS JPEG-LS, libjpeg (in Pillow) JPEG Baseline, and pydicom RLE. The header is that of the slice, with what the encoding changes.
"""

import copy
import io
import json
import pathlib
import sys
import tempfile

import jpeg_ls
import numpy as np
import pydicom
import SimpleITK
from PIL import Image
from pydicom.encaps import encapsulate, generate_frames
from pydicom.uid import UID

from facts import hu_of, sha256

samples = pathlib.Path(sys.argv[1])
folder = samples / "codecs"
folder.mkdir(exist_ok=True)
#: A slice with the inserts of the phantom.
SOURCE = pydicom.dcmread(sorted((samples / "catphan504-cbct").glob("CT.*.dcm"))[10])
# Elements are decoded when they are read, and an undecoded one cannot be written in another byte order.
SOURCE.walk(lambda dataset, element: None)
STORED = SOURCE.pixel_array
HU = hu_of(SOURCE)
facts = []


def write(name, syntax, pixels, lossy=None, **changed):
    """Writes a file of these pixel bytes. `lossy` are the HU that a decoder finds where they are not those of the slice."""
    slice_ = copy.deepcopy(SOURCE)
    slice_.file_meta.TransferSyntaxUID = UID(syntax)
    for key, value in changed.items():
        setattr(slice_, key, value)
    slice_.PixelData = pixels
    slice_["PixelData"].VR = "OB" if slice_.file_meta.TransferSyntaxUID.is_encapsulated else "OW"
    slice_["PixelData"].is_undefined_length = slice_.file_meta.TransferSyntaxUID.is_encapsulated
    order = {"implicit_vr": syntax == "1.2.840.10008.1.2", "little_endian": syntax != "1.2.840.10008.1.2.2"}
    pydicom.dcmwrite(folder / name, slice_, enforce_file_format=True, **order)
    hu = HU if lossy is None else lossy
    facts.append({
        "file": name, "transfer_syntax": syntax, "RescaleSlope": str(slice_.RescaleSlope), "RescaleIntercept": str(slice_.RescaleIntercept),
        "sha256_stored_int16le": sha256(STORED) if lossy is None else None,
        "hu_min_max_mean": [float(hu.min()), float(hu.max()), round(float(hu.mean()), 4)],
        "max_abs_hu_diff_vs_reference": float(np.abs(hu - HU.astype(np.float64)).max()),
    })


def by_gdcm(compressor):
    """The only frame, as GDCM compresses it without loss."""
    with tempfile.TemporaryDirectory() as place:
        path = f"{place}/slice.dcm"
        writer = SimpleITK.ImageFileWriter()
        writer.SetImageIO("GDCMImageIO")
        writer.SetUseCompression(True)
        writer.SetCompressor(compressor)
        writer.SetFileName(path)
        writer.Execute(SimpleITK.GetImageFromArray(STORED))
        return next(generate_frames(pydicom.dcmread(path).PixelData, number_of_frames=1))


def lossless():
    bytes_ = STORED.astype("<u2").tobytes()
    write("CTImage.dcm", "1.2.840.10008.1.2", bytes_)
    write("CTImage_LittleEndianImplicit_1.2.840.10008.1.2.dcm", "1.2.840.10008.1.2", bytes_)
    write("CTImage_LittleEndianExplicit_1.2.840.10008.1.2.1.dcm", "1.2.840.10008.1.2.1", bytes_)
    write("CTImage_DeflatedExplicitVRLittleEndian_1.2.840.10008.1.2.1.99.dcm", "1.2.840.10008.1.2.1.99", bytes_)
    write("CTImage_BigEndianExplicit_1.2.840.10008.1.2.2.dcm", "1.2.840.10008.1.2.2", STORED.astype(">u2").tobytes())
    rle = pydicom.pixels.get_encoder(pydicom.uid.RLELossless).encode(STORED, **pydicom.pixels.utils.as_pixel_options(SOURCE))
    write("CTImage_RLELossless_1.2.840.10008.1.2.5.dcm", "1.2.840.10008.1.2.5", encapsulate([rle]))
    # A stream of the first predictor is one of Process 14 too.
    jpeg = encapsulate([by_gdcm("JPEG")])
    write("CTImage_JPEGProcess14_1.2.840.10008.1.2.4.57.dcm", "1.2.840.10008.1.2.4.57", jpeg)
    write("CTImage_JPEGProcess14SV1_1.2.840.10008.1.2.4.70.dcm", "1.2.840.10008.1.2.4.70", jpeg)
    write("CTImage_JPEG2000LosslessOnly_1.2.840.10008.1.2.4.90.dcm", "1.2.840.10008.1.2.4.90", encapsulate([by_gdcm("JPEG2000")]))
    write("CTImage_JPEGLSLossless_1.2.840.10008.1.2.4.80.dcm", "1.2.840.10008.1.2.4.80", encapsulate([bytes(jpeg_ls.encode_array(STORED))]))


def lossy():
    near = bytes(jpeg_ls.encode_array(STORED, lossy_error=2))
    found = jpeg_ls.decode(np.frombuffer(near, np.uint8)).reshape(STORED.shape)
    write("CTImage_JPEGLSLossy_1.2.840.10008.1.2.4.81.dcm", "1.2.840.10008.1.2.4.81", encapsulate([near]),
          found * float(SOURCE.RescaleSlope) + float(SOURCE.RescaleIntercept))
    # 8 bits: steps of 16 HU.
    slope, low = 16.0, float(HU.min())
    file = io.BytesIO()
    Image.fromarray(np.rint((HU - low) / slope).astype(np.uint8)).save(file, "JPEG", quality=95)
    found = np.asarray(Image.open(io.BytesIO(file.getvalue())))
    write("CTImage_JPEGProcess1_1.2.840.10008.1.2.4.50.dcm", "1.2.840.10008.1.2.4.50", encapsulate([file.getvalue()]),
          found * slope + low, BitsAllocated=8, BitsStored=8, HighBit=7, RescaleSlope=slope, RescaleIntercept=low)


lossless()
lossy()
(samples / "codecs.facts.json").write_text(json.dumps(facts, indent=1) + "\n", encoding="utf-8")
