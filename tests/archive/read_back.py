"""Reads every object of Orthanc back by WADO-RS, and says what each is, as JSON.

usage: read_back.py URL-of-dicom-web LOGIN PICTURE...

Reports and segmentations are read by highdicom, pictures are compared with the files, in their order.
"""

import base64
import io
import json
import sys
import urllib.request
from email import message_from_bytes

import highdicom
import numpy
import pydicom
from PIL import Image

root, login, *pictures = sys.argv[1:]
HEADERS = {"Authorization": "Basic " + base64.b64encode(login.encode()).decode()}


def get(path, accept):
    request = urllib.request.Request(root + path, headers={**HEADERS, "Accept": accept})
    with urllib.request.urlopen(request) as answer:
        return answer.headers["Content-Type"], answer.read()


def objects():
    found = json.loads(get("/instances?limit=1000", "application/dicom+json")[1])
    for one in found:
        study, series, uid = (one[tag]["Value"][0] for tag in ("0020000D", "0020000E", "00080018"))
        kind, body = get(
            f"/studies/{study}/series/{series}/instances/{uid}", 'multipart/related; type="application/dicom"; transfer-syntax=*'
        )
        message = message_from_bytes(f"Content-Type: {kind}\r\n\r\n".encode() + body)
        yield message.get_payload()[0].get_payload(decode=True)


def described(data):
    found = pydicom.dcmread(io.BytesIO(data))
    if found.Modality == "SR":
        report = highdicom.sr.srread(io.BytesIO(data))
        return {"kind": "SR", "items": len(report.content), "patient": str(found.PatientID)}
    if found.Modality == "SEG":
        segments = highdicom.seg.segread(io.BytesIO(data))
        return {"kind": "SEG", "segments": segments.number_of_segments, "patient": str(found.PatientID)}
    if found.Modality == "OT":
        frames = found.pixel_array
        frames = frames if frames.ndim == 4 else frames[None]
        wanted = [numpy.asarray(Image.open(path).convert("RGB")) for path in pictures]
        same = [any(numpy.array_equal(frame, picture) for picture in wanted) for frame in frames]
        return {"kind": "OT", "frames": len(frames), "same": all(same), "patient": str(found.PatientID)}
    return {"kind": found.Modality}


counted = [described(data) for data in objects()]
print(json.dumps([one for one in counted if one["kind"] != "CT"]))
