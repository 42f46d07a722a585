"""Files of OpenCV's FileStorage: its dialect of YAML, and the matrices in YAML, XML and JSON."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from mssegment.errors import MssegmentError

if TYPE_CHECKING:
    from xml.etree import ElementTree

_FLOATS = {"f": np.float32, "d": np.float64, "h": np.float16}
_LONG = 1000
"""Characters of a list of numbers that is kept from the parser of YAML."""
_MARK = "mssegment-list-"
_KEYPOINT = 7
"""Numbers of a keypoint: x, y, size, angle, response, octave, class."""
_MATCH = 4
"""Numbers of a match: the indices of both keypoints, of the image, and the distance."""


def of_yaml(text: str, name: str, error: type[MssegmentError]) -> dict[str, Any]:
    """The mapping in a YAML file, also in the dialect of OpenCV; empty if it holds none.

    Parameters
    ----------
    text : str
        The file.
    name : str
        Its name, for errors.
    error : type
        The error to raise.

    Returns
    -------
    dict

    Raises
    ------
    MssegmentError
        ``error``, with line and column, for a file with keys that is not YAML.
    """
    import yaml

    from mssegment.inputs.yaml_nodes import check_nodes, check_text

    class Loader(yaml.SafeLoader):
        """Reads tagged values, such as ``!!opencv-matrix``, as what they are written as."""

    def tagged(loader: Loader, suffix: str, node: yaml.Node) -> Any:
        if isinstance(node, yaml.MappingNode):
            return loader.construct_mapping(node, deep=True)
        if isinstance(node, yaml.SequenceNode):
            return loader.construct_sequence(node, deep=True)
        return loader.construct_scalar(node)  # type: ignore[arg-type]

    Loader.add_multi_constructor("tag:yaml.org,2002:opencv", tagged)
    Loader.add_multi_constructor("!", tagged)
    # blank lines for directives keep the numbers of the others
    lines = ["" if line.startswith("%") else line for line in text.splitlines()]
    # OpenCV wrote `key:value` without a blank in old versions
    after = r"[^\s:/]" if text.lstrip("\ufeff").startswith("%YAML") else r"[\d.+-]"
    key = re.compile(rf"^(\s*[A-Za-z_][\w.]*):(?={after})")
    plain = "\n".join(key.sub(r"\1: ", line) for line in lines)
    plain, blocks = _without_blocks(plain)
    check_text(plain, name, error)
    try:
        # `rostopic echo` ends each message with a line of dashes
        node = next(iter(yaml.compose_all(plain, Loader=Loader)), None)
        check_nodes(node, name, error)
        found = None if node is None else Loader("").construct_document(node)
    except yaml.MarkedYAMLError as failure:
        if not re.search(r"^\s*[A-Za-z_][\w.]*\s*:", text, re.M):
            return {}  # not meant as YAML
        mark = failure.problem_mark
        place = f":{mark.line + 1}:{mark.column + 1}" if mark else ""
        raise error(f"{name}{place}: not YAML ({failure.problem})") from None
    except (
        *(yaml.YAMLError, ValueError, OverflowError, TypeError, RecursionError),
        *(AttributeError, KeyError, IndexError),  # a scalar that is not what its tag says
    ) as failure:
        raise error(f"{name}: not YAML ({' '.join(str(failure).split())})") from None
    try:
        return _with_blocks(found, blocks) if isinstance(found, dict) else {}
    except (ValueError, RecursionError):
        raise error(f"{name}: a damaged list of numbers, or nested too deeply") from None


def _without_blocks(text: str) -> tuple[str, list[str]]:
    """The text with a mark for each long list of numbers, and these lists.

    The parser of YAML needs a second for 20 000 numbers.
    """
    blocks: list[str] = []

    def mark(match: re.Match[str]) -> str:
        if len(match[1]) < _LONG:
            return match[0]
        blocks.append(match[1])
        lines = "\n" * match[1].count("\n")  # errors name lines
        return f"[ {_MARK}{len(blocks) - 1}{lines} ]"

    return re.sub(r"\[([-+.\deE,\s]*)\]", mark, text), blocks


def _with_blocks(value: Any, blocks: list[str]) -> Any:
    """The tree with the lists instead of their marks."""
    if isinstance(value, dict):
        return {key: _with_blocks(own, blocks) for key, own in value.items()}
    if not isinstance(value, list):
        return value
    if len(value) == 1 and isinstance(value[0], str) and value[0].startswith(_MARK):
        words = blocks[int(value[0].removeprefix(_MARK))].replace(",", " ").split()
        return np.array(words, dtype=np.float64).tolist()
    return [_with_blocks(own, blocks) for own in value]


def of_element(element: ElementTree.Element) -> Any:
    """The children of an XML element by name; of one without children its numbers, or its text."""
    if len(element):
        return {child.tag: of_element(child) for child in element}
    words = (element.text or "").split()
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        return " ".join(words).strip('"')
    return numbers[0] if len(numbers) == 1 else numbers


def arrays_of(tree: Mapping[str, Any]) -> dict[str, Any]:
    """The values of a tree, OpenCV's matrices as arrays [rows, columns(, channels)].

    Lists of keypoints become their positions [n, 2], and lists of matches pairs of indices [n, 2].
    Whatever is none of these stays as it is.
    """
    return {str(key): _array(value) for key, value in tree.items()}


def _array(value: Any) -> Any:
    if isinstance(value, Mapping) and {"rows", "cols", "dt", "data"} <= set(value):
        found = _matrix(value)
        return value if found is None else found
    for length, kind in ((_KEYPOINT, np.float64), (_MATCH, np.float64)):
        if isinstance(value, list) and value and all(_is_row(row, length) for row in value):
            rows = np.array(value, dtype=kind)
            if length == _KEYPOINT and (rows[:, 2] > 0).all():
                return rows[:, :2]
            if length == _MATCH and not rows[:, 2].any() and _are_indices(rows[:, :2]):
                return rows[:, :2].astype(np.int64)
    return value


def _is_row(row: Any, length: int) -> bool:
    return (
        isinstance(row, list) and len(row) == length and all(type(v) in (int, float) for v in row)
    )


def _are_indices(values: Any) -> bool:
    return bool(((values >= 0) & (values == np.round(values)) & (values < 2**31)).all())


def _matrix(value: Mapping[str, Any]) -> Any:
    """The matrix that rows, cols, dt (``2f`` has two channels) and data state; None if damaged."""
    match = re.fullmatch(r"(\d*)([ucwsihfd])", str(value["dt"]).strip('" '))
    data = value["data"].split() if isinstance(value["data"], str) else value["data"]
    try:
        shape = int(value["rows"]), int(value["cols"]), int(match[1] or 1) if match else 0
        flat = np.array(data, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    if match is None or flat.ndim != 1 or min(shape) < 1 or flat.size != int(np.prod(shape)):
        return None
    kind = _FLOATS.get(match[2], np.int64)
    whole = np.isfinite(flat).all() and (np.abs(flat) < 2**53).all()
    values = flat.astype(kind) if match[2] in _FLOATS or whole else flat
    return values.reshape(shape if shape[2] > 1 else shape[:2])
