"""Annotations as dataclasses and tables."""

from __future__ import annotations

import dataclasses
import datetime
import json
import os
import uuid
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any, Optional

from . import _native

if TYPE_CHECKING:
    import pandas  # type: ignore[import-untyped, unused-ignore]


@dataclasses.dataclass(frozen=True)
class Annotation:
    """An annotation: a point, line, angle, curve, plane, region or mesh. `item` is its JSON, as the HTTP interface has it."""

    name: str
    set: str
    kind: str
    points_mm: tuple[tuple[float, float, float], ...]
    author: str
    description: str
    item: dict[str, Any] = dataclasses.field(repr=False, compare=False)

    @classmethod
    def point(cls, name: str, position_mm: Iterable[float], *, author: str, set: str = "default", description: str = "") -> Annotation:
        """A new landmark at a patient position, LPS mm."""
        now = datetime.datetime.now(datetime.timezone.utc)
        return _annotation({
            "id": str(uuid.uuid4()), "set": set, "name": name, "description": description, "state": "defined",
            "geometry": {"kind": "point", "at_mm": [float(value) for value in position_mm]},
            "author": author, "created": now.strftime("%Y-%m-%dT%H:%M:%SZ"),
        })

    @property
    def position_mm(self) -> Optional[tuple[float, float, float]]:
        """The place of a point, patient LPS mm; None for others."""
        return self.points_mm[0] if self.kind == "point" and self.points_mm else None


#: Keys of a geometry that are places.
PLACES = ("at_mm", "ends_mm", "points_mm", "center_mm")


def _annotation(item: dict[str, Any]) -> Annotation:
    geometry = item.get("geometry") or {}
    places: list[Any] = next((geometry[key] for key in PLACES if key in geometry), [])
    points = [places] if places and not isinstance(places[0], list) else places
    return Annotation(
        name=item["name"],
        set=item["set"],
        kind=geometry.get("kind", item.get("state", "missing")),
        points_mm=tuple((float(x), float(y), float(z)) for x, y, z in points),
        author=item["author"],
        description=item.get("description", ""),
        item=item,
    )


def read_annotations(path: str | os.PathLike[str], format: Optional[str] = None) -> list[Annotation]:
    """Reads annotations from a file of 3D Slicer, MITK, OHIF or DICOM; the format is recognised unless it is named."""
    items, _ = _native.read_annotations(path, format)
    return [_annotation(item) for item in json.loads(items)]


def write_annotations(annotations: Iterable[Annotation], path: str | os.PathLike[str], format: str) -> list[str]:
    """Writes a file in a format such as mrk.json, fcsv or csv, in this order; gives what the format cannot represent."""
    items = [{**annotation.item, "order": order} for order, annotation in enumerate(annotations)]
    data, left_out = _native.write_annotations(json.dumps(items), format)
    with open(path, "wb") as file:
        file.write(data)
    return left_out


def annotations_table(annotations: Iterable[Annotation]) -> pandas.DataFrame:
    """A table with a row for each place: set, name, kind, number, x, y and z in mm (LPS), and author."""
    import pandas

    rows = [
        (one.set, one.name, one.kind, number, *point, one.author)
        for one in annotations
        for number, point in enumerate(one.points_mm)
    ]
    return pandas.DataFrame(rows, columns=["set", "name", "kind", "number", "x_mm", "y_mm", "z_mm", "author"])
