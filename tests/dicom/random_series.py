"""Random legal CT series, written by pydicom, with the volumes that they hold.

usage: random_series.py FOLDER FIRST COUNT

Makes COUNT folders, of the seeds FIRST and following ones. Prints a JSON object for each: its folder, its kind, the volumes
(dimensions, spacing, origin, directions, SHA-256 of the HU as 16-bit numbers from the lowest slice on) and the codes of the
warnings that a reader owes.
"""

import hashlib
import json
import os
import random
import sys

import numpy as np
import pydicom
from pydicom.dataset import Dataset, FileDataset, FileMetaDataset
from pydicom.uid import (
    CTImageStorage,
    DeflatedExplicitVRLittleEndian,
    EnhancedCTImageStorage,
    ExplicitVRBigEndian,
    ExplicitVRLittleEndian,
    ImplicitVRLittleEndian,
    RLELossless,
)

FOLDER, FIRST, COUNT = sys.argv[1], int(sys.argv[2]), int(sys.argv[3])
SYNTAXES = [ImplicitVRLittleEndian, ExplicitVRLittleEndian, ExplicitVRBigEndian, DeflatedExplicitVRLittleEndian, RLELossless]
NAMES = [
    (None, "Plain^Ascii"),
    ("ISO_IR 100", "Müller^Jürgen"),
    ("ISO_IR 144", "Люкceмбypг"),
    ("ISO_IR 192", "Wang^XiaoDong=王^小东"),
    ("GB18030", "Wang^XiaoDong=王^小东"),
    (["", "ISO 2022 IR 87"], "Yamada^Tarou=山田^太郎=やまだ^たろう"),
    (["", "ISO 2022 IR 149"], "Hong^Gildong=洪^吉洞=홍^길동"),
    ("ISO_IR 148", "Öztürk^Ayşe"),
]
KINDS = [
    "plain", "plain", "plain", "turned", "two patients", "two studies", "two frames of reference", "phases by position index",
    "phases by trigger time", "phases by acquisition", "missing slice", "repeated slice", "two kernels", "localizer beside",
    "empty series uid", "damaged file beside", "two sizes", "falling order", "uneven time of each slice",
    "enhanced", "enhanced, shuffled frames", "enhanced in two objects", "enhanced phases", "enhanced stacks",
]


class Series:
    """The attributes that the slices of one volume share."""

    def __init__(self, dice):
        self.dice = dice
        self.uids = {name: pydicom.uid.generate_uid() for name in ("study", "series", "frame")}
        self.patient_id = f"P{dice.randrange(10**6)}"
        self.charset, self.name = dice.choice(NAMES)
        self.syntax = dice.choice(SYNTAXES)
        self.rows, self.columns, self.count = dice.randint(3, 20), dice.randint(3, 20), dice.randint(4, 10)
        scale = dice.choice([1, 1, 1, 0.05])
        self.spacing = [round(scale * dice.uniform(0.3, 2), 4) for _ in range(2)]
        self.step = round(scale * dice.uniform(0.4, 3), 4)
        self.origin = np.array([round(dice.uniform(-200, 200), 2) for _ in range(3)])
        self.directions = np.eye(3)
        self.is_signed, self.stored = dice.random() < 0.5, dice.choice([12, 16])
        self.slope = dice.choice([1, 1, 1, 2])
        self.intercept = 0 if self.is_signed else -1024
        self.more = {}

    def turned(self):
        """Any directions, also falling slices of a mirrored stack."""
        axis = np.array([self.dice.gauss(0, 1) for _ in range(3)])
        axis /= np.linalg.norm(axis)
        angle = self.dice.uniform(0, 3.1)
        x, y, z = axis
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        self.directions = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        return self

    def voxels(self):
        """Stored values."""
        low, high = (-1024, 2**(self.stored - 1) - 1) if self.is_signed else (0, 2**self.stored - 1)
        high = min(high, 16000)
        values = np.random.default_rng(self.dice.randrange(2**32)).integers(low, high, (self.count, self.rows, self.columns))
        return values.astype(np.int32)

    def place(self, slice_index):
        return self.origin + self.directions[:, 2] * self.step * slice_index

    def slice(self, values, index, number, **more):
        meta = FileMetaDataset()
        meta.TransferSyntaxUID = ExplicitVRLittleEndian if self.syntax == RLELossless else self.syntax
        meta.MediaStorageSOPClassUID, meta.MediaStorageSOPInstanceUID = CTImageStorage, pydicom.uid.generate_uid()
        is_big = self.syntax == ExplicitVRBigEndian
        one = FileDataset(None, {}, file_meta=meta, preamble=b"\0" * 128, is_little_endian=not is_big)
        one.SOPClassUID, one.SOPInstanceUID, one.Modality = CTImageStorage, meta.MediaStorageSOPInstanceUID, "CT"
        one.StudyInstanceUID, one.SeriesInstanceUID, one.FrameOfReferenceUID = (self.uids[key] for key in ("study", "series", "frame"))
        if self.charset:
            one.SpecificCharacterSet = self.charset
        one.PatientName, one.PatientID, one.ImageType = self.name, self.patient_id, ["ORIGINAL", "PRIMARY", "AXIAL"]
        one.InstanceNumber, one.AcquisitionNumber = number, 1
        one.ImagePositionPatient = [f"{value:.8g}" for value in self.place(index)]
        one.ImageOrientationPatient = [f"{value:.8f}" for value in [*self.directions[:, 0], *self.directions[:, 1]]]
        one.PixelSpacing = [f"{self.spacing[1]:.6g}", f"{self.spacing[0]:.6g}"]
        one.SliceThickness = f"{self.step:.6g}"
        one.SamplesPerPixel, one.PhotometricInterpretation = 1, "MONOCHROME2"
        one.Rows, one.Columns = self.rows, self.columns
        one.BitsAllocated, one.BitsStored, one.HighBit = 16, self.stored, self.stored - 1
        one.PixelRepresentation = int(self.is_signed)
        one.RescaleSlope, one.RescaleIntercept, one.RescaleType = self.slope, self.intercept, "HU"
        for key, value in {**self.more, **more}.items():
            setattr(one, key, value)
        order = ">" if self.syntax == ExplicitVRBigEndian else "<"
        one.PixelData = values.astype(order + ("i2" if self.is_signed else "u2")).tobytes()
        if self.syntax == RLELossless:
            one.compress(RLELossless)
        return one

    def enhanced(self, values, indices, content=lambda frame: {}):
        """An Enhanced CT object (PS3.3 A.38): a frame for each index of a slice, with these attributes of its content."""
        one = self.slice(values[indices[0]], indices[0], 1)
        in_frames = self.dice.random() < 0.5
        transformation, frame_type, measures = Dataset(), Dataset(), Dataset()
        for key in ("RescaleSlope", "RescaleIntercept", "RescaleType"):
            setattr(transformation, key, getattr(one, key))
        frame_type.FrameType = ["ORIGINAL", "PRIMARY", "VOLUME", "NONE"]
        measures.PixelSpacing, measures.SliceThickness = one.PixelSpacing, one.SliceThickness
        orientation = Dataset()
        orientation.ImageOrientationPatient = one.ImageOrientationPatient
        shared, per_frame = Dataset(), []
        shared.PixelMeasuresSequence, shared.CTImageFrameTypeSequence = [measures], [frame_type]
        if not in_frames:
            shared.PlaneOrientationSequence, shared.PixelValueTransformationSequence = [orientation], [transformation]
        for frame, index in enumerate(indices):
            position, contents, groups = Dataset(), Dataset(), Dataset()
            position.ImagePositionPatient = [f"{value:.8g}" for value in self.place(index)]
            contents.FrameAcquisitionNumber = 1
            for key, value in content(frame).items():
                setattr(contents, key, value)
            groups.PlanePositionSequence, groups.FrameContentSequence = [position], [contents]
            if in_frames:
                groups.PlaneOrientationSequence, groups.PixelValueTransformationSequence = [orientation], [transformation]
            per_frame.append(groups)
        for key in ("ImagePositionPatient", "ImageOrientationPatient", "PixelSpacing", "SliceThickness", "RescaleSlope",
                    "RescaleIntercept", "RescaleType"):
            delattr(one, key)
        one.file_meta.MediaStorageSOPClassUID = one.SOPClassUID = EnhancedCTImageStorage
        one.ImageType = ["ORIGINAL", "PRIMARY", "VOLUME", "NONE"]
        one.SharedFunctionalGroupsSequence, one.PerFrameFunctionalGroupsSequence = [shared], per_frame
        one.NumberOfFrames = len(indices)
        order = ">" if self.syntax == ExplicitVRBigEndian else "<"
        one.PixelData = values[indices].astype(order + ("i2" if self.is_signed else "u2")).tobytes()
        if self.syntax == RLELossless:
            one.file_meta.TransferSyntaxUID = ExplicitVRLittleEndian
            one["PixelData"].is_undefined_length = False
            one.compress(RLELossless)
        return one

    def slices(self, values, **more):
        return [self.slice(values[index], index, index + 1, **more) for index in range(self.count)]

    def volume(self, values, count=None):
        hu = np.clip(values * self.slope + self.intercept, -32768, 32767).astype("<i2")
        return {
            "dims": [self.columns, self.rows, count or self.count],
            "spacing_mm": [*self.spacing, self.step],
            "origin_mm": self.origin.tolist(),
            "direction": self.directions.flatten().tolist(),
            "stack_sha256": hashlib.sha256(hu.tobytes()).hexdigest(),
        }


def made(seed):
    """Files, volumes and warnings of one folder."""
    dice = random.Random(seed)
    kind = KINDS[seed % len(KINDS)]
    one = Series(dice)
    values = one.voxels()
    files, volumes, warnings = one.slices(values), [one.volume(values)], set()
    other = one.voxels()

    def beside(**more):
        """The same places again, as another volume."""
        files.extend(one.slices(other, **more))
        volumes.append(one.volume(other))

    def phases():
        for number, volume in enumerate(volumes):
            volume["phase"] = [number + 1, len(volumes)]

    if kind == "turned":
        one.turned()
        files, volumes = one.slices(values), [one.volume(values)]
    elif kind == "two patients":
        if dice.random() < 0.5:
            one.uids["series"] = ""
            files = one.slices(values)
        beside(PatientID="Q" + one.patient_id)
    elif kind == "two studies":
        beside(StudyInstanceUID=pydicom.uid.generate_uid())
    elif kind == "two frames of reference":
        beside(FrameOfReferenceUID=pydicom.uid.generate_uid())
    elif kind == "phases by position index":
        files = one.slices(values, TemporalPositionIdentifier=1)
        beside(TemporalPositionIdentifier=2)
        phases()
    elif kind == "phases by trigger time":
        files = one.slices(values, TriggerTime="0")
        beside(TriggerTime="450")
        phases()
    elif kind == "phases by acquisition":
        beside(AcquisitionNumber=2)
        phases()
    elif kind == "two kernels":
        files = one.slices(values, ConvolutionKernel="B30f")
        beside(ConvolutionKernel="B70f")
    elif kind == "missing slice":
        # The gap is filled by interpolation: dimensions and hash of the stack as read.
        gone = dice.randrange(1, one.count - 1)
        files.pop(gone)
        volumes = [one.volume(np.delete(values, gone, 0))]
        warnings.add("uneven-spacing")
    elif kind == "repeated slice":
        again = dice.randrange(one.count)
        files.append(one.slice(values[again], again, again + 1))
        warnings.add("duplicate-position")
    elif kind == "localizer beside":
        files.append(one.slice(values[0], 50, 99, ImageType=["ORIGINAL", "PRIMARY", "LOCALIZER"]))
    elif kind == "empty series uid":
        one.uids["series"] = ""
        files = one.slices(values)
    elif kind == "two sizes":
        one.rows += 1
        other = one.voxels()
        beside()
    elif kind.startswith("enhanced"):
        if dice.random() < 0.5:
            one.turned()
        volumes = [one.volume(values)]
        all_slices = list(range(one.count))
        if kind == "enhanced":
            files = [one.enhanced(values, all_slices)]
        elif kind == "enhanced, shuffled frames":
            dice.shuffle(all_slices)
            files = [one.enhanced(values, all_slices, lambda frame: {"InStackPositionNumber": frame + 1})]
        elif kind == "enhanced in two objects":
            half = one.count // 2
            files = [one.enhanced(values, all_slices[:half]), one.enhanced(values, all_slices[half:])]
        else:
            # Two volumes at the same places in one object: the frames of the second follow those of the first, or alternate.
            both = np.concatenate([values, other])
            keys = [(volume, index) for volume in range(2) for index in range(one.count)]
            if dice.random() < 0.5:
                keys = [(volume, index) for index in range(one.count) for volume in range(2)]
            name = "TemporalPositionIndex" if kind == "enhanced phases" else "StackID"
            value = (lambda volume: volume + 1) if kind == "enhanced phases" else (lambda volume: str(volume + 1))
            place, frames = one.place, [volume * one.count + index for volume, index in keys]
            one.place = lambda index: place(index % one.count)
            files = [one.enhanced(both, frames, lambda frame: {name: value(keys[frame][0])})]
            one.place = place
            volumes.append(one.volume(other))
            if kind == "enhanced phases":
                phases()
    elif kind == "uneven time of each slice":
        for number, file in enumerate(files):
            file.AcquisitionTime = f"1200{number:02d}.{dice.randrange(10**6):06d}"
            file.ContentTime = file.AcquisitionTime
    folder = os.path.join(FOLDER, f"{seed:06}")
    os.makedirs(folder)
    if kind != "falling order":
        dice.shuffle(files)
    for number, file in enumerate(reversed(files)):
        name = dice.choice(["{:04}.dcm", "IM{:06}", "{:03}.ima"]).format(number)
        file.save_as(os.path.join(folder, f"{number:03}-{name}"), enforce_file_format=True)
    if kind == "damaged file beside":
        with open(os.path.join(folder, "zz.dcm"), "wb") as damaged:
            damaged.write(b"\0" * 128 + b"DICM" + dice.randbytes(200))
    return {"folder": folder, "kind": kind, "seed": seed, "volumes": volumes, "warnings": sorted(warnings)}


for number in range(COUNT):
    print(json.dumps(made(FIRST + number)), flush=True)
