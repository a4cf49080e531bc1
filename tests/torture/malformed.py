"""Malformed DICOM in 24 categories, and the program's answer to each.

A category is a list of small series, each made from a whole one by damaging one thing of one slice or of all. Files are little
endian with explicit value representations, as `relief phantom` writes them. The program renders each series in a process of its
own, under a ceiling of address space.
"""

import dataclasses
import os
import resource
import struct
import subprocess
import time

SECONDS = 5  # an input that takes longer counts as a hang
CEILING = 4 << 30  # bytes of address space; the driver of the software adapter reserves much of it
PEAK_MIB = 512
LONG = {b"OB", b"OD", b"OF", b"OL", b"OW", b"SQ", b"UC", b"UN", b"UR", b"UT"}
ROWS, COLUMNS, BITS_ALLOCATED, BITS_STORED, SPACING, POSITION, ORIENTATION, SLOPE, INTERCEPT, PIXELS, FRAMES, CHARSET, SAMPLES, UID = (
    (0x28, 0x10), (0x28, 0x11), (0x28, 0x100), (0x28, 0x101), (0x28, 0x30), (0x20, 0x32), (0x20, 0x37), (0x28, 0x1053),
    (0x28, 0x1052), (0x7FE0, 0x10), (0x28, 0x8), (0x8, 0x5), (0x28, 0x2), (0x8, 0x18),
)  # fmt: skip
SYNTAX = (0x2, 0x10)


def element(tag, vr, value, length=None):
    """The bytes of an element; `length` is the one that it declares."""
    length = len(value) if length is None else length
    if vr in LONG:
        return struct.pack("<HH2sHI", *tag, vr, 0, length & 0xFFFFFFFF) + value
    return struct.pack("<HH2sH", *tag, vr, length & 0xFFFF) + value


class Slice:
    """A file as a preamble and a list of elements (tag, VR, value)."""

    def __init__(self, data):
        self.preamble, self.elements, at = data[:132], [], 132
        while at < len(data):
            group, number, vr, short = struct.unpack_from("<HH2sH", data, at)
            head, length = (12, struct.unpack_from("<I", data, at + 8)[0]) if vr in LONG else (8, short)
            self.elements.append(((group, number), vr, data[at + head : at + head + length]))
            at += head + length

    def bytes(self, replaced=None, dropped=(), added=b""):
        """The file with raw bytes in place of some elements, without others, and with more before the pixels."""
        out = self.preamble
        for tag, vr, value in self.elements:
            if tag == PIXELS:
                out += added
            if tag not in dropped:
                out += (replaced or {}).get(tag) or element(tag, vr, value)
        return out

    def with_value(self, tag, text, vr=None):
        """The file with another value of an element."""
        known = next((found for found in self.elements if found[0] == tag), None)
        value = text if isinstance(text, bytes) else text.encode() + b" " * (len(text.encode()) % 2)
        made = element(tag, vr or (known[1] if known else b"LO"), value)
        return self.bytes({tag: made}) if known else self.bytes(added=made)

    def value(self, tag):
        return next(value for found, _, value in self.elements if found == tag)


def whole(number):
    return struct.pack("<H", number)


def values(tag, texts):
    return [lambda s, text=text: s.with_value(tag, text) for text in texts]


def encapsulated(syntax, *fragments, end=True):
    """A file whose pixels are fragments, each with the length that it declares."""

    def make(one):
        body = b"".join(struct.pack("<HHI", 0xFFFE, 0xE000, length) + data for length, data in fragments)
        body += struct.pack("<HHI", 0xFFFE, 0xE0DD, 0) if end else b""
        replaced = {
            SYNTAX: element(SYNTAX, b"UI", syntax + b"\0" * (len(syntax) % 2)),
            PIXELS: element(PIXELS, b"OB", body, 0xFFFFFFFF),
        }
        return one.bytes(replaced)

    return make


def nested(depth, closed):
    def make(one):
        opened = struct.pack("<HH2sHIHHI", 0x40, 0xA730, b"SQ", 0, 0xFFFFFFFF, 0xFFFE, 0xE000, 0xFFFFFFFF) * depth
        closing = struct.pack("<HHIHHI", 0xFFFE, 0xE00D, 0, 0xFFFE, 0xE0DD, 0) * depth if closed else b""
        return one.bytes(added=opened + closing)

    return make


RLE, JPEG, J2K, DEFLATED = (b"1.2.840.10008.1.2.5", b"1.2.840.10008.1.2.4.70", b"1.2.840.10008.1.2.4.90", b"1.2.840.10008.1.2.1.99")
OFFSET = (0, b"")


def cut(share):
    return lambda s: s.bytes()[: int(len(s.bytes()) * share)]


def declared(tag, vr, length):
    return lambda s: s.bytes({tag: element(tag, vr, s.value(tag), length)})


CATEGORIES = {
    "cut within preamble or meta header": [lambda s, n=n: s.bytes()[:n] for n in (0, 1, 100, 131, 132, 140, 200)],
    "cut within the data set": [cut(share) for share in (0.2, 0.3, 0.4)],
    "cut within the pixels": [cut(share) for share in (0.6, 0.9, 0.999)],
    "missing or other prefix than DICM": [lambda s: s.bytes()[132:], lambda s: b"\0" * 128 + b"DICK" + s.bytes()[132:]],
    "wrong length of the meta header": [lambda s, n=n: s.with_value((2, 0), struct.pack("<I", n)) for n in (0, 3, 65536, 0xFFFFFFFF)],
    "transfer syntax missing or unknown": [lambda s: s.bytes(dropped=[SYNTAX])] + values(SYNTAX, ["1.2.3", "", "x" * 64, "9" * 63]),
    "another transfer syntax than the bytes have": values(SYNTAX, ["1.2.840.10008.1.2", "1.2.840.10008.1.2.2", DEFLATED.decode()]),
    "undefined lengths without an end": [declared((8, 0x60), b"UN", 0xFFFFFFFF), declared((8, 0x60), b"SQ", 0xFFFFFFFF)],
    "odd lengths": [declared((8, 0x60), b"CS", 1), declared(PIXELS, b"OW", 511)],
    "lengths beyond the file": [declared((8, 0x60), b"CS", 65535), declared(PIXELS, b"OW", 0xFFFFFFFE), declared((8, 0x60), b"UT", 0x7FFFFFFF)],
    "elements out of order or repeated": [
        lambda s: s.preamble + b"".join(element(*e) for e in s.elements[:7] + s.elements[:6:-1]),
        lambda s: s.bytes(added=b"".join(element(*e) for e in s.elements if e[0] in (ROWS, COLUMNS, POSITION))),
    ],
    "unknown value representations": [
        lambda s, vr=vr: s.bytes({ROWS: element(ROWS, vr, s.value(ROWS))}) for vr in (b"ZZ", b"\0\0", b"DS", b"SQ", b"\xff\xff")
    ],
    "no rows or columns": [lambda s, t=t: s.with_value(t, whole(0)) for t in (ROWS, COLUMNS)] + [lambda s, t=t: s.bytes(dropped=[t]) for t in (ROWS, COLUMNS)],
    "more pixels declared than there are": [lambda s, t=t: s.with_value(t, whole(65535)) for t in (ROWS, COLUMNS)] + values(FRAMES, ["65535", "2147483647", "-1"]),
    "impossible bits": [lambda s, t=t, n=n: s.with_value(t, whole(n)) for t in (BITS_ALLOCATED, BITS_STORED) for n in (0, 1, 7, 33, 65535)],
    "several samples a pixel": [lambda s, n=n: s.with_value(SAMPLES, whole(n)) for n in (0, 3, 65535)],
    "invalid pixel spacing": values(SPACING, ["0\\0", "-1\\-1", "NaN\\NaN", "1e308\\1e308", "1", "a\\b", "", "1\\1\\1"]),
    "invalid positions": values(POSITION, ["NaN\\0\\0", "1e308\\0\\0", "0\\0", "", "x\\y\\z", "inf\\inf\\inf"]),
    "invalid orientations": values(ORIENTATION, ["0\\0\\0\\0\\0\\0", "1\\0\\0\\1\\0\\0", "1\\0\\0", "NaN\\0\\0\\0\\1\\0", "9\\0\\0\\0\\9\\0"]),
    "invalid rescaling": values(SLOPE, ["0", "NaN", "1e300", "-1e300", "", "abc"]) + values(INTERCEPT, ["NaN", "1e300", "9" * 16]),
    "deep nesting": [nested(depth, closed) for depth in (100, 10_000) for closed in (True, False)],
    "fragments of RLE": [
        encapsulated(RLE, OFFSET, (64, struct.pack("<16I", 0xFFFFFFFE, *[64] * 15))),
        encapsulated(RLE, OFFSET, (192, struct.pack("<16I", 2, 64, 128, *[0] * 13) + b"\x81\0" * 64)),
        encapsulated(RLE, OFFSET, (8, b"\0" * 8)),
        encapsulated(RLE, OFFSET),
    ],
    "fragments of JPEG and JPEG 2000": [
        encapsulated(syntax, *fragments, end=end)
        for syntax in (JPEG, J2K)
        for fragments, end in [
            ([OFFSET, (0xFFFFFFF0, b"\xff\xd8")], False),
            ([OFFSET, (4, b"\xff\xd8\xff\xd9")], True),
            ([(8, struct.pack("<II", 0, 0xFFFFFFF0)), (2, b"\xff\xd8")], True),
            ([OFFSET, (64, b"\xff\x4f\xff\x51" + b"\xff" * 60)], True),
        ]
    ],
    "texts of unknown or wrong character sets": values(CHARSET, ["ISO_IR 999", "\\\\\\", "x" * 64]) + values((0x8, 0x103E), [b"\xff\xfe\x1b$B" * 40]),
}


def run(program, series, folder):
    """Status, seconds, peak in MiB and the reason for the first file of rendering a series."""
    command = [program, "render", "--series", series, "--preset", "bone", "--layout", "color", "--size", "32x24"]
    since = time.monotonic()
    limit = lambda: resource.setrlimit(resource.RLIMIT_AS, (CEILING, CEILING))  # noqa: E731
    process = subprocess.Popen(
        [*command, "--out", folder / "frame.png"], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, preexec_fn=limit
    )
    said = process.stderr.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = 0
    code = -(status & 127) if status & 127 else status >> 8
    # The line of the first file says why; the one before it names the series.
    refusal = next((line.strip() for line in said.splitlines() if line.startswith("  ")), "")
    return code, time.monotonic() - since, usage.ru_maxrss / 1024, refusal


@dataclasses.dataclass
class Category:
    """The program's verdicts on the series of a category."""

    name: str
    refused: int = 0
    accepted: int = 0
    seconds: float = 0.0  # of the slowest
    mib: float = 0.0  # of the largest peak
    refusal: str = ""  # the first one

    @property
    def inputs(self):
        return self.refused + self.accepted


def render_all(program, slices, folder):
    """The program's verdicts on each category; and the failures as texts."""
    categories, failures = [], []
    for name, damages in CATEGORIES.items():
        category = Category(name)
        for number, damage in enumerate(damages):
            for which in ("one", "all"):
                series = folder / f"{len(categories)}-{number}-{which}"
                series.mkdir(parents=True)
                for index, one in enumerate(slices):
                    is_damaged = which == "all" or index == len(slices) // 2
                    (series / f"{index}.dcm").write_bytes(damage(one) if is_damaged else one.bytes())
                code, seconds, mib, said = run(program, series, folder)
                category.refused, category.accepted = category.refused + (code != 0), category.accepted + (code == 0)
                category.seconds, category.mib = max(category.seconds, seconds), max(category.mib, mib)
                category.refusal = category.refusal or said
                if code < 0 or code == 101 or seconds > SECONDS or mib > PEAK_MIB:
                    failures.append(f"{name} {number} ({which}): status {code}, {seconds:.1f} s, {mib:.0f} MiB: {said}")
        categories.append(category)
    return categories, failures
