"""Tables in JSON: records, nested records, the forms of pandas, tracks of COCO, keypoints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from mssegment.datasets.columns import FRAME, TRACK, first_of, plain

Record = dict[str, Any]

_LISTS = ("frames", "annotations", "detections", "objects", "results", "tracks", "images", "data")
"""Names of the list of records in an object."""
_BOX = frozenset(("bbox", "box", "bounding_box", "tlwh", "xywh", "bbox_tlwh", "bbox_xywh"))
_CORNERS = frozenset(("tlbr", "xyxy", "ltrb", "bbox_xyxy", "bbox_tlbr"))
_POINT = frozenset(("point", "position", "pos", "xy", "center", "centre", "centroid", "location"))
_KEYPOINTS = "keypoints"
_LIKELY = 0.5


def columns_of(content: Mapping[str, Any]) -> dict[str, list[Any]]:
    """The columns of the table that a parsed JSON file holds; empty if it holds none.

    Nested records, such as the objects of each frame, become one record each, with the values of
    the outer one. Boxes, points and lists of keypoints become columns of numbers.
    """
    for form in (_of_split, _of_columns, _of_tracks, _of_nested):
        found = form(content)
        if found:
            return found
    records = [flat for record in _records(content) for flat in _flattened(record)]
    if not records:
        return {}
    records = [own for record in records for own in _of_keypoints(_without_lists(record))]
    names = dict.fromkeys(name for record in records for name in record)
    return {name: [record.get(name) for record in records] for name in names}


def _of_split(content: Mapping[str, Any]) -> dict[str, list[Any]]:
    """The form of ``DataFrame.to_json(orient="split")``."""
    names, rows = content.get("columns"), content.get("data")
    if not isinstance(names, list) or not isinstance(rows, list) or not rows:
        return {}
    if not all(isinstance(row, list) and len(row) == len(names) for row in rows):
        return {}
    return {str(name): [row[i] for row in rows] for i, name in enumerate(names)}


def _of_columns(content: Mapping[str, Any]) -> dict[str, list[Any]]:
    """The form of ``DataFrame.to_json()``: the values of each column by their row."""
    if not content or not all(isinstance(v, dict) and v for v in content.values()):
        return {}
    keys = list(next(iter(content.values())))
    if not all(list(own) == keys for own in content.values()):
        return {}
    if any(isinstance(v, dict | list) for own in content.values() for v in own.values()):
        return {}
    return {str(name): list(own.values()) for name, own in content.items()}


def _of_tracks(content: Mapping[str, Any]) -> dict[str, list[Any]]:
    """The rows [frame, x, y] of each track by its identifier."""
    if len(content) < 2 or not all(isinstance(v, list) and v for v in content.values()):
        return {}
    rows = [
        [str(track), *row] if isinstance(row, list) and len(row) == 3 else None
        for track, own in content.items()
        for row in own
    ]
    found = [row for row in rows if row is not None and not any(isinstance(v, list) for v in row)]
    if len(found) < len(rows):
        return {}
    return {name: [row[i] for row in found] for i, name in enumerate(("track", "frame", "x", "y"))}


def _of_nested(content: Mapping[str, Any]) -> dict[str, list[Any]]:
    """The positions [x, y] of each frame by their track, or of each track by their frame.

    A frame has positions all over the picture, and those of a track are near each other.
    """
    if len(content) < 2 or not all(isinstance(v, dict) and v for v in content.values()):
        return {}
    points = [_numbers(value) for own in content.values() for value in own.values()]
    if not all(len(point) == 2 for point in points):
        return {}
    outer = [name for name, own in content.items() for _ in own]
    inner = [str(name) for own in content.values() for name in own]
    if _spread(inner, points) <= _spread(outer, points):
        track, frame = inner, outer
    else:
        track, frame = outer, inner
    x, y = ([point[axis] for point in points] for axis in (0, 1))
    return {"track": track, "frame": frame, "x": x, "y": y}


def _spread(keys: list[str], points: list[list[float]]) -> float:
    """The sum of the squared distances of points from the mean of those with the same key."""
    groups: dict[str, list[list[float]]] = {}
    for key, point in zip(keys, points, strict=True):
        groups.setdefault(key, []).append(point)
    return float(
        sum(
            np.var(np.array(own, dtype=np.float64), axis=0).sum() * len(own)
            for own in groups.values()
        )
    )


def _records(content: Mapping[str, Any]) -> list[Record]:
    """The list of records in the file; of COCO the annotations, with the names of their images."""
    if {"images", "annotations"} <= set(content):
        return _of_coco(content)
    lists = [content[name] for name in ("", *_LISTS) if name in content]
    found = next((own for own in lists if isinstance(own, list) and own), [])
    return [record for record in found if isinstance(record, dict)]


def _of_coco(content: Mapping[str, Any]) -> list[Record]:
    if not isinstance(content["images"], list) or not isinstance(content["annotations"], list):
        return []
    names = {
        str(image.get("id")): image.get("frame_id", image.get("file_name", image.get("id")))
        for image in content["images"]
        if isinstance(image, dict)
    }
    records = [record for record in content["annotations"] if isinstance(record, dict)]
    if not all(first_of(record, TRACK[:-3]) not in (None, "id") for record in records):
        return []  # annotations of single pictures
    unused = ("id", "category_id", "segmentation", "area", "iscrowd", "image_id")
    return [
        {"frame": names.get(str(record.get("image_id")))}
        | {name: value for name, value in record.items() if name not in unused}
        for record in records
    ]


def _flattened(record: Record) -> Iterator[Record]:
    """The inner records of a record that has one list of records, or else the record itself."""
    inner = [name for name, value in record.items() if _are_records(value)]
    if len(inner) != 1:
        yield record
        return
    outer = {name: value for name, value in record.items() if name != inner[0]}
    for own in record[inner[0]]:
        yield {**outer, **own}


def _are_records(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, dict) for v in value)


def _without_lists(record: Record) -> Record:
    """The record with the numbers of boxes and points as values of their own."""
    found: Record = {}
    for name, value in record.items():
        short = plain(name)
        numbers = _numbers(value)
        if len(numbers) == 4 and short in _BOX:
            found |= dict(zip(("left", "top", "width", "height"), numbers, strict=True))
        elif len(numbers) == 4 and short in _CORNERS:
            found |= dict(zip(("left", "top", "right", "bottom"), numbers, strict=True))
        elif len(numbers) in (2, 3) and short in _POINT:
            found |= dict(zip("xy", numbers, strict=False))
        elif short == _KEYPOINTS or not isinstance(value, list | dict):
            found[name] = value
    return found


def _numbers(value: Any) -> list[float]:
    """The numbers of a list, or of an object that names them in order; empty for anything else."""
    values = list(value.values()) if isinstance(value, dict) else value
    if not isinstance(values, list) or not all(type(v) in (int, float) for v in values):
        return []
    return values


def _of_keypoints(record: Record) -> list[Record]:
    """One record for each keypoint (x, y, score) of a person; each is a track."""
    if _KEYPOINTS not in record:
        return [record]
    numbers = _numbers(record[_KEYPOINTS])
    track = first_of([*record, "idx"], (*TRACK, "idx"))
    frame = first_of([name for name in record if name != track], FRAME)
    if not numbers or len(numbers) % 3 or track not in record or frame is None:
        record.pop(_KEYPOINTS, None)
        return [record]
    return [
        {"track": f"{record[track]} {i // 3}", "frame": record[frame]}
        | {"x": numbers[i], "y": numbers[i + 1], "visible": int(numbers[i + 2] >= _LIKELY)}
        for i in range(0, len(numbers), 3)
    ]
