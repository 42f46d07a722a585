"""INI, XML, numpy archives and Matlab files as trees of named values."""

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
    # Matlab parts rows by semicolons, which would begin comments
    plain = re.sub(r"\[[^\]\n=]*\]", lambda match: match[0].replace(";", ","), text)
    try:
        parser.read_string(f"[{head}]\n{plain}")
    except (configparser.DuplicateOptionError, configparser.DuplicateSectionError) as error:
        what = error.option if isinstance(error, configparser.DuplicateOptionError) else "it"
        place = f": line {error.lineno - 1}" if error.lineno else ""  # without the heading above
        section = "" if error.section == head else f"[{error.section}]: "
        raise ConfigurationError(
            f"{name}{place}: {section}{what} stands twice; keep one of them"
        ) from None
    except configparser.ParsingError as error:
        raise ConfigurationError(
            f"{name}: line {error.errors[0][0] - 1}: expected name = value"
        ) from None
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


def of_xml(text: str, name: str) -> dict[str, Any]:
    """The elements of an XML file by name, with their text, or mappings where they have children.

    Raises ConfigurationError if the file is not XML, or defines entities.
    """
    from xml.etree import ElementTree

    from mssegment.inputs.opencv_storage import of_element

    if "<!DOCTYPE" in text or "<!ENTITY" in text:
        raise ConfigurationError(f"{name}: XML with a DOCTYPE is not read; expected OpenCV's")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise ConfigurationError(f"{name}: not XML ({error})") from None

    try:
        found = of_element(root)
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
