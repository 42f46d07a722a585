"""TrackMate's XML: the export of tracks (particles with detections), and its own files."""

from __future__ import annotations

from xml.etree import ElementTree

from mssegment.datasets.base import DataSet, ImportedTracks
from mssegment.datasets.containers import InputFile, Variables
from mssegment.datasets.sightings import read_sightings
from mssegment.datasets.tables import Table
from mssegment.errors import DataError
from mssegment.inputs.encodings import text_of
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
    if not isinstance(root, ElementTree.Element):
        return False
    return root.find("particle/detection") is not None or _is_model(root)


def _is_model(root: ElementTree.Element) -> bool:
    """Whether the file is one that TrackMate saves for itself, with spots and edges."""
    return root.find("Model/AllTracks/Track/Edge") is not None


def read(file: InputFile) -> ImportedTracks:
    """Read the detections; raises DataError if one has no position."""
    root: ElementTree.Element = file.variables["root"]
    columns: dict[str, list[str]] = {"track": [], "frame": [], "x": [], "y": []}
    if _is_model(root):
        _add_model(root, columns, file.name)
    for number, particle in enumerate(root.iter("particle")):
        for detection in particle.iter("detection"):
            columns["track"].append(str(number))
            for name, key in (("frame", "t"), ("x", "x"), ("y", "y")):
                columns[name].append(detection.get(key, ""))
    count = len(columns["track"])
    found = read_sightings(Table(file.name, columns, range(1, count + 1)), file)
    model = root.find("Model")
    unit = root.get("spaceUnits") if model is None else model.get("spatialunits")
    unit = unit or "pixel"
    note = f"TrackMate: positions in units of {unit}" if unit not in ("pixel", "pixels") else ""
    return replace(found, notes=(*found.notes, *([note] if note else [])))


def _add_model(root: ElementTree.Element, columns: dict[str, list[str]], name: str) -> None:
    """Add the spots of the tracks that TrackMate's filters have left.

    Raises DataError for an edge to a spot that is not there.
    """
    spots = {spot.get("ID"): spot for spot in root.iterfind("Model/AllSpots/SpotsInFrame/Spot")}
    left = {own.get("TRACK_ID") for own in root.iterfind("Model/FilteredTracks/TrackID")}
    for track in root.iterfind("Model/AllTracks/Track"):
        key = track.get("TRACK_ID", "")
        if left and key not in left:
            continue
        ends = (
            edge.get(end)
            for edge in track.iterfind("Edge")
            for end in ("SPOT_SOURCE_ID", "SPOT_TARGET_ID")
        )
        for end in dict.fromkeys(ends):
            if end not in spots:
                raise DataError(f"{name}: track {key} has a spot {end} that is not in the file")
            columns["track"].append(key)
            for column, attribute in (("frame", "FRAME"), ("x", "POSITION_X"), ("y", "POSITION_Y")):
                columns[column].append(spots[end].get(attribute, ""))


TRACKMATE = DataSet(
    "trackmate", "TrackMate's XML, exported tracks or its own files", ("xml",), recognises, read
)
