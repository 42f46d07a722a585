"""Reads numpydoc docstrings: the text before the sections, and the fields they describe."""

from __future__ import annotations

import inspect
import re

FIELD_SECTIONS = ("Attributes", "Parameters")
_SECTION = re.compile(r"^(\w[\w ]*)\n-{3,}\n", re.MULTILINE)
_FIELD = re.compile(r"^(\w+(?:, \w+)*)(?: *: *(.*))?$")


def prose(thing: object) -> str:
    """The summary and the extended summary: everything before the first section."""
    return _parts(thing)[""]


def summary(thing: object) -> str:
    """The first paragraph on one line."""
    return " ".join(prose(thing).split("\n\n")[0].split())


def fields(thing: object) -> dict[str, tuple[str, str]]:
    """The description and the stated type of each attribute or parameter, by name."""
    found: dict[str, tuple[str, str]] = {}
    parts = _parts(thing)
    for title in FIELD_SECTIONS:
        names: list[str] = []
        for line in parts.get(title, "").splitlines():
            match = _FIELD.match(line)
            if match:
                names = match[1].split(", ")
                found |= dict.fromkeys(names, ("", match[2] or ""))
            for name in names if line.startswith(" ") else ():
                found[name] = (f"{found[name][0]} {line.strip()}".strip(), found[name][1])
    return found


def _parts(thing: object) -> dict[str, str]:
    text = inspect.cleandoc(getattr(thing, "__doc__", None) or "")
    pieces = _SECTION.split(text)
    return {"": pieces[0].strip(), **dict(zip(pieces[1::2], pieces[2::2], strict=True))}
