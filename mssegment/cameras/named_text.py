"""Cameras in plain text: names beside numbers, one row of names, and ROS's ``ost.txt``."""

from __future__ import annotations

import re

from mssegment.cameras.base import CameraFile, CameraFormat, camera_of_matrix, matrix_of
from mssegment.cameras.named_values import camera_of_tree
from mssegment.records import Camera

_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_NAME = r"[A-Za-z]\w{0,40}"
_PAIR = re.compile(
    rf"\s*({_NAME})\s*[:=,;]?\s+({_NUMBER})\s*[,;]?|\s*({_NAME})[:=,;]({_NUMBER})[,;]?"
)
_HEADING = re.compile(
    r"^\s*(camera matrix|distortion|rectification|projection|width|height)\s*$", re.M
)


def read(file: CameraFile) -> dict[str, Camera]:
    """The camera of such a text. Raises ConfigurationError for a value that no camera has."""
    text = "\n".join(
        line for line in file.text.splitlines() if not line.lstrip().startswith(("#", "%"))
    ).strip()
    found = _of_ost(text, file.name) or _of_pairs(text, file.name) or _of_row(text, file.name)
    return {"": found} if found is not None else {}


def _of_pairs(text: str, name: str) -> Camera | None:
    """``fx 800`` or ``fx: 800, fy: 800``: nothing else may stand in the text."""
    values: dict[str, str] = {}
    place = 0
    while match := _PAIR.match(text, place):
        key, value = (match[1], match[2]) if match[1] else (match[3], match[4])
        if key in values:
            return None
        values[key] = value
        place = match.end()
    return camera_of_tree(values, name) if values and not text[place:].strip() else None


def _of_row(text: str, name: str) -> Camera | None:
    """A line with the names, and one with the numbers."""
    lines = [re.split(r"[\s,;]+", line.strip(" ,;")) for line in text.splitlines() if line.strip()]
    if len(lines) != 2 or len(lines[0]) != len(lines[1]):
        return None
    if not all(re.fullmatch(_NUMBER, word) for word in lines[1]):
        return None
    return camera_of_tree(dict(zip(*lines, strict=True)), name)


def _of_ost(text: str, name: str) -> Camera | None:
    """ROS's older form: headings, each with its numbers below it."""
    if "camera matrix" not in text:
        return None
    parts = _HEADING.split(text)
    values = {
        title: [float(word) for word in re.findall(_NUMBER, body.split("[")[0])]
        for title, body in zip(parts[1::2], parts[2::2], strict=False)
    }
    matrix = matrix_of(values.get("camera matrix", []))
    if matrix is None:
        return None
    sides = [values.get(title, []) for title in ("width", "height")]
    size = (int(sides[0][0]), int(sides[1][0])) if all(len(side) == 1 for side in sides) else None
    bent = values.get("distortion", [])
    return camera_of_matrix(matrix, name, bent, None, size)


NAMED_TEXT = CameraFormat("named_text", "names beside numbers, ROS's ost.txt", read)
