"""TrackMate's XML export of tracks: particles with detections."""

from __future__ import annotations

from xml.etree import ElementTree

from mssegment.datasets.base import DataSet, ImportedTracks
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.sightings import read_sightings
from mssegment.datasets.tables import Table, text_of
from mssegment.errors import DataError
from mssegment.records import replace


def load_xml(file: InputFile) -> Variables:
    """The root element of an XML file; raises DataError if it is damaged or defines entities."""
    text = text_of(file.content, file.name)
    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise DataError(f"{file.name}: HTML, or XML with a DOCTYPE; expected tracks")
    try:
        # the declaration may name the encoding that was decoded already
        return {"root": ElementTree.fromstring(text.partition("?>")[2].strip() or text)}
    except (ElementTree.ParseError, ValueError) as error:
        raise DataError(f"{file.name}: not XML ({error}); expected tracks") from None


def recognises(content: Variables) -> bool:
    """Whether the root element holds tracks of TrackMate."""
    root = content.get("root")
    return isinstance(root, ElementTree.Element) and root.find("particle/detection") is not None


def read(file: InputFile) -> ImportedTracks:
    """Read the detections; raises DataError if one has no position."""
    root: ElementTree.Element = file.variables["root"]
    columns: dict[str, list[str]] = {"track": [], "frame": [], "x": [], "y": []}
    for number, particle in enumerate(root.iter("particle")):
        for detection in particle.iter("detection"):
            columns["track"].append(str(number))
            for name, key in (("frame", "t"), ("x", "x"), ("y", "y")):
                columns[name].append(detection.get(key, ""))
    count = len(columns["track"])
    found = read_sightings(Table(file.name, columns, range(1, count + 1)), file)
    unit = root.get("spaceUnits", "pixel")
    note = f"TrackMate: positions in units of {unit}" if unit not in ("pixel", "pixels") else ""
    return replace(found, notes=(*found.notes, *([note] if note else [])))


TRACKMATE = DataSet("trackmate", "TrackMate's XML export of tracks", ("xml",), recognises, read)
