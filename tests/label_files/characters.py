"""Segmentations whose labels are in every character set of PS3.3 C.12.1.1.2, written by pydicom and highdicom.

usage: characters.py FOLDER

Prints a list: the file, and its labels as pydicom reads them back. The last files are label maps (Supplement 243).
"""

import json
import os
import sys

import highdicom
import numpy as np
import pydicom
from highdicom.sr.coding import CodedConcept
from pydicom.dataset import FileDataset, FileMetaDataset
from pydicom.uid import CTImageStorage, ExplicitVRLittleEndian

FOLDER = sys.argv[1]
#: Specific Character Set, and labels: with a set in G1, in G0, with both, with a delimiter between, and alone.
SETS = [
    ("", ["Liver", "a-b_c 1"]),
    ("ISO_IR 100", ["Länge", "foie gêné"]),
    ("ISO_IR 101", ["Wałęsa", "Łukasz"]),
    ("ISO_IR 109", ["ĝardeno", "ħobż"]),
    ("ISO_IR 110", ["ķēniņš", "Ģertrūde"]),
    ("ISO_IR 144", ["Печень", "Лёгкое"]),
    ("ISO_IR 127", ["كبد", "قلب"]),
    ("ISO_IR 126", ["ήπαρ", "Διονυσιος"]),
    ("ISO_IR 138", ["כבד", "לב"]),
    ("ISO_IR 148", ["Öztürk", "Ayşe ğı"]),
    ("ISO_IR 166", ["ตับ", "หัวใจ"]),
    ("ISO_IR 13", ["ｶﾝｿﾞｳ", "ｼﾝ"]),
    ("ISO_IR 192", ["肝臓", "Печень Länge 간"]),
    ("GB18030", ["肝脏", "左肾乗孃㐀"]),
    ("GBK", ["肝脏", "孃 a"]),
    ("\\ISO 2022 IR 87", ["肝臓 A 左腎", "表 B"]),
    ("\\ISO 2022 IR 159", ["丂", "A 侲 B"]),
    ("\\ISO 2022 IR 87\\ISO 2022 IR 159", ["肝丂臓", "丂 A 肝"]),
    ("ISO 2022 IR 13\\ISO 2022 IR 87", ["ｶﾝｿﾞｳ 肝臓", "右ﾐｷﾞ"]),
    ("\\ISO 2022 IR 149", ["간", "왼쪽 신장 A"]),
    ("ISO 2022 IR 100\\ISO 2022 IR 144", ["Länge Печень", "Печень Länge"]),
    ("ISO 2022 IR 100\\ISO 2022 IR 126\\ISO 2022 IR 138", ["é ή כ", "כבד é"]),
    ("ISO 2022 IR 6\\ISO 2022 IR 100", ["Müller", "a"]),
]
#: What pydicom does not write: the labels, and their bytes by Python's codecs.
OTHERS = [
    ("ISO_IR 13", ["ABC ｼﾝ", "ﾐｷﾞ a"], ["ABC ｼﾝ".encode("shift_jis"), "ﾐｷﾞ a".encode("shift_jis")]),
    ("ISO_IR 203", ["Œuvre €", "Žofia"], ["Œuvre €".encode("iso8859_15"), "Žofia".encode("iso8859_15")]),
    ("\\ISO 2022 IR 58", ["肝脏", "左肾 B 胸部"], [b"\x1b$)A" + name.encode("gb2312") for name in ["肝脏", "左肾 B 胸部"]]),
    ("\\ISO 2022 IR 58", ["肝脏", "a"], ["肝脏".encode("gb2312"), b"a"]),  # without the escape sequence, as pydicom writes it
    (
        "ISO 2022 IR 148\\ISO 2022 IR 203",
        ["Ayşe Œ", "€ ğ"],
        ["Ayşe ".encode("iso8859_9") + b"\x1b-b" + "Œ".encode("iso8859_15"), b"\x1b-b" + "€".encode("iso8859_15") + b" \x1b-M" + "ğ".encode("iso8859_9")],
    ),
]


def slices():
    ids = [pydicom.uid.generate_uid() for _ in range(3)]
    made = []
    for number in range(4):
        meta = FileMetaDataset()
        meta.TransferSyntaxUID, meta.MediaStorageSOPClassUID = ExplicitVRLittleEndian, CTImageStorage
        meta.MediaStorageSOPInstanceUID = pydicom.uid.generate_uid()
        one = FileDataset(None, {}, file_meta=meta, preamble=b"\0" * 128)
        one.SOPClassUID, one.SOPInstanceUID, one.Modality = CTImageStorage, meta.MediaStorageSOPInstanceUID, "CT"
        one.StudyInstanceUID, one.SeriesInstanceUID, one.FrameOfReferenceUID = ids
        one.PatientName = one.PatientID = one.PatientBirthDate = one.PatientSex = one.AccessionNumber = ""
        one.StudyDate = one.StudyTime = one.StudyID = one.ReferringPhysicianName = ""
        one.SeriesNumber, one.InstanceNumber = 1, number + 1
        one.ImagePositionPatient, one.ImageOrientationPatient = [0, 0, 2 * number], [1, 0, 0, 0, 1, 0]
        one.PixelSpacing, one.SliceThickness = [1, 1], 2
        one.SamplesPerPixel, one.PhotometricInterpretation = 1, "MONOCHROME2"
        one.Rows = one.Columns = 8
        one.BitsAllocated, one.BitsStored, one.HighBit, one.PixelRepresentation = 16, 16, 15, 0
        one.RescaleSlope, one.RescaleIntercept = 1, -1024
        one.PixelData = np.zeros((8, 8), np.uint16).tobytes()
        made.append(one)
    return made


SLICES = slices()


def segmentation(names, kind):
    mask = np.zeros((4, 8, 8, len(names)), np.uint8)
    for number in range(len(names)):
        mask[1:3, 2 * number : 2 * number + 2, 1:7, number] = 1
    tissue = CodedConcept("85756007", "SCT", "Tissue")
    manual = highdicom.seg.SegmentAlgorithmTypeValues.MANUAL
    described = [
        highdicom.seg.SegmentDescription(number + 1, f"segment {number}", tissue, tissue, manual) for number in range(len(names))
    ]
    uids = [highdicom.UID(), highdicom.UID()]
    return highdicom.seg.Segmentation(
        SLICES, mask, kind, described, uids[0], 1, uids[1], 1, "Maker", "Model", "1", "0", content_label="SEG"
    )


def labelled(found, names):
    own = [item for item in found.SegmentSequence if item.SegmentNumber > 0]
    for item, name in zip(own, names):
        item.SegmentLabel = name
    return found


def main():
    written = []

    def save(found, name):
        path = os.path.join(FOLDER, name)
        found.save_as(path)
        read = [str(item.SegmentLabel) for item in pydicom.dcmread(path).SegmentSequence if item.SegmentNumber > 0]
        written.append({"path": path, "name": name, "labels": read})

    for number, (charset, names) in enumerate(SETS):
        found = segmentation(names, "BINARY")
        found.SpecificCharacterSet = charset.split("\\") if charset else None
        save(labelled(found, names), f"{number:02} {charset.replace(chr(92), ' and ')}.dcm")
        assert written[-1]["labels"] == names, (charset, written[-1])
    for charset, names, encoded in OTHERS:
        found = segmentation(names, "BINARY")
        found.SpecificCharacterSet = charset.split("\\")
        save(labelled(found, encoded), f"by hand {len(written)}, {charset.replace(chr(92), ' and ')}.dcm")
        written[-1]["labels"] = names
    # An item with a set of its own.
    found = segmentation(["a", "b"], "BINARY")
    found.SpecificCharacterSet = "ISO_IR 100"
    found.SegmentSequence[1].SpecificCharacterSet = "ISO_IR 144"
    save(labelled(found, ["Länge", "Печень"]), "an item of its own.dcm")
    # Label maps, which describe their background or do not.
    found = segmentation(["a", "b"], "LABELMAP")
    found.SpecificCharacterSet = "ISO_IR 192"
    save(labelled(found, ["肝臓", "Печень"]), "label map.dcm")
    assert found.SOPClassUID == "1.2.840.10008.5.1.4.1.1.66.7"
    del found.SegmentSequence[0]
    assert found.SegmentSequence[0].SegmentNumber == 1
    save(found, "label map without background.dcm")
    print(json.dumps(written))


main()
