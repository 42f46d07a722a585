"""YAML, INI, XML, numpy archives and Matlab files as trees of named values."""

from __future__ import annotations

import io
import re
from typing import Any

import numpy as np

from mssegment.errors import ConfigurationError, DataError
from mssegment.inputs.numpy_headers import DAMAGED, check_arrays

_SECTION = re.compile(r"\s*\[[^\]\[]+\]\s*")
_ASSIGNMENT = re.compile(r"\s*[A-Za-z_][\w. -]*\s*=\s*[^=]*")
_INI_COMMENT = ("#", ";", "%", "//")


def is_ini(text: str) -> bool:
    """Whether every line is ``[section]``, ``key = value`` or a comment."""
    lines = [line for line in text.splitlines() if line.strip()]
    lines = [line for line in lines if not line.lstrip().startswith(_INI_COMMENT)]
    return any("=" in line for line in lines) and all(
        _SECTION.fullmatch(line) or _ASSIGNMENT.fullmatch(line) for line in lines
    )


def of_ini(text: str, name: str) -> dict[str, Any]:
    """The values of ``key = value`` lines, those of a section as a mapping.

    Raises ConfigurationError if a key or section stands twice.
    """
    import configparser

    head = "\0"
    parser = configparser.ConfigParser(
        comment_prefixes=_INI_COMMENT, inline_comment_prefixes=("#", ";"), interpolation=None
    )
    try:
        parser.read_string(f"[{head}]\n{text}")
    except configparser.Error as error:
        raise ConfigurationError(f"{name}: {' '.join(str(error).split())}") from None
    found: dict[str, Any] = {key: _number_or_text(value) for key, value in parser[head].items()}
    for section in parser.sections():
        if section != head:
            found[section] = {k: _number_or_text(v) for k, v in parser[section].items()}
    return found


def _number_or_text(value: str) -> Any:
    try:
        return float(value.rstrip(";"))
    except ValueError:
        return value


def of_matlab(content: bytes, name: str) -> dict[str, Any]:
    """The variables of a Matlab file, single numbers as such.

    Raises ConfigurationError if it cannot be read.
    """
    from mssegment.datasets.containers import InputFile
    from mssegment.datasets.matlab import load_matlab

    try:
        variables = load_matlab(InputFile(name, content))
    except DataError as error:
        raise ConfigurationError(str(error)) from None
    return {
        key: value.item() if isinstance(value, np.ndarray) and value.size == 1 else _listed(value)
        for key, value in variables.items()
    }


def _listed(value: Any) -> Any:
    """Arrays of numbers as lists, structs as mappings of the same."""
    if isinstance(value, dict):
        return {key: _listed(own) for key, own in value.items()}
    return value.tolist() if isinstance(value, np.ndarray) else value


def of_yaml(text: str, name: str) -> dict[str, Any]:
    """The mapping in a YAML file, also in the dialect of OpenCV; empty if it holds none.

    Raises ConfigurationError, with line and column, for a file with keys that is not YAML.
    """
    import yaml

    from mssegment.inputs.yaml_nodes import check_nodes

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
    lines = [line for line in text.splitlines() if not line.startswith("%")]
    # OpenCV writes `key:value` without a blank in old versions
    plain = "\n".join(re.sub(r"^(\s*[A-Za-z_][\w.]*):(?=[\d.+-])", r"\1: ", line) for line in lines)
    try:
        # `rostopic echo` ends each message with a line of dashes
        node = next(iter(yaml.compose_all(plain, Loader=Loader)), None)
        check_nodes(node, name, ConfigurationError)
        found = None if node is None else Loader("").construct_document(node)
    except yaml.MarkedYAMLError as error:
        if not re.search(r"^\s*[A-Za-z_][\w.]*\s*:", text, re.M):
            return {}  # not meant as YAML
        mark = error.problem_mark
        place = f":{mark.line + 1}:{mark.column + 1}" if mark else ""
        raise ConfigurationError(f"{name}{place}: not YAML ({error.problem})") from None
    except (
        *(yaml.YAMLError, ValueError, OverflowError, TypeError, RecursionError),
        *(AttributeError, KeyError, IndexError),  # a scalar that is not what its tag says
    ) as error:
        raise ConfigurationError(f"{name}: not YAML ({' '.join(str(error).split())})") from None
    return found if isinstance(found, dict) else {}


def of_xml(text: str, name: str) -> dict[str, Any]:
    """The elements of an XML file by name, with their text, or mappings where they have children.

    Raises ConfigurationError if the file is not XML, or defines entities.
    """
    from xml.etree import ElementTree

    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ConfigurationError(f"{name}: XML with a DOCTYPE is not read; expected OpenCV's")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise ConfigurationError(f"{name}: not XML ({error})") from None

    def value(element: ElementTree.Element) -> Any:
        if len(element):
            return {child.tag: value(child) for child in element}
        words = (element.text or "").split()
        try:
            numbers = [float(word) for word in words]
        except ValueError:
            return " ".join(words).strip('"')
        return numbers[0] if len(numbers) == 1 else numbers

    try:
        found = value(root)
    except RecursionError:
        raise ConfigurationError(f"{name}: XML that is nested too deeply for a camera") from None
    return found if isinstance(found, dict) else {}


def of_numpy(content: bytes, name: str) -> dict[str, Any]:
    """The arrays of a ``.npz`` by name, or of a ``.npy`` as ``K``.

    Raises ConfigurationError if the file is damaged or pickled.
    """
    check_arrays(content, name, ConfigurationError)
    try:
        found = np.load(io.BytesIO(content), allow_pickle=False)
        if isinstance(found, np.ndarray):
            return {"K": found.tolist()}
        return {key: found[key].tolist() for key in found.files}
    except DAMAGED as error:
        reason = " ".join(str(error).split())
        raise ConfigurationError(f"{name}: not a readable numpy file ({reason})") from None
