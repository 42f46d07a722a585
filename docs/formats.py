"""The page of document formats, made from the types of the documents."""

from __future__ import annotations

import re
import types
from collections.abc import Iterator
from typing import Any, Union, get_args, get_origin, get_type_hints

import msgspec
import numpy as np

from docs.docstrings import fields, prose, summary
from mssegment.documents import DOCUMENTS, Document
from mssegment.schema import NAMES

REPORT_FIELDS = {
    "schema": ("string", "`mssegment/report/1`."),
    "motions": ("number", "How many motions were found."),
    "misclassification": ("number or null", "0 to 1; null without true labels."),
    "confusion": (
        "list of lists of numbers, or null",
        "Tracks by true motion (rows) and found motion (columns), outliers last.",
    ),
    "modes": (
        "list of objects",
        "Each with `hypotheses`, `kde`, `motion` (0: none), `set` and `model`, densest first.",
    ),
    "res": (
        "list of numbers, or null",
        "Equation (23) for each motion; null where it has no true partner.",
    ),
    "res_hat": ("list of numbers, or null", "Equation (24) for each motion."),
    "counted": ("number or null", "Tracks that the misclassification counts."),
    "adjusted_rand": ("number or null", "Adjusted Rand index of the counted tracks."),
    "world": (
        "number or null",
        "The found label that is right where the true label is 0; null if 0 is an outlier.",
    ),
    "objects": (
        "list of objects, or null",
        "The true objects, each with `true`, `motion` (matched), `iou` of the tracks, and `J` and "
        "`F` of the masks.",
    ),
    "true_motions": ("list of numbers, or null", "The labels of the rows of `confusion`."),
    "found_motions": ("list of numbers, or null", "The labels of its columns."),
    "camera_motion": (
        "number or null",
        "The motion of the static world under a moving camera; null if there is none.",
    ),
    "motion_list": (
        "list of objects",
        "Each with `label`, `model`, `inliers`, `hypotheses`, `kde`, `scale` and `rms` (pixels), "
        "`cost_saved` (nats), `log_nfa` (significance), `separation` (from the nearest other "
        "motion, above 1), `rigid_evidence` (nats), `parts` (the motions that were joined to one "
        "rigid body), `true_motion`, `parameters`, and the motion in pixels: `matrix`, or "
        "`direction` and `epipole`.",
    ),
    "tracks": ("number", "Number of tracks."),
    "outliers": ("number", "How many have label 0."),
    "background": ("number", "How many have label -1."),
    "not_judged": ("number", "How many have label -2."),
    "labels": ("list of numbers", "The found label of each track."),
    "true_labels": ("list of numbers, or null", "The true label of each track."),
    "bandwidths": ("list of numbers", "The bandwidth of each set of hypotheses."),
    "hypotheses": ("number", "Number of hypotheses in all sets."),
    "notes": ("list of strings", "What the stages reported."),
    "frames": ("list of objects", "Each with `path`, `width`, `height` and `index`."),
    "history": ("list of objects", "The stages, as in the documents."),
}
"""The keys of report.json, whose values are built by hand: type and meaning."""


def formats_page() -> str:
    """The JSON documents: every type with its fields, and report.json."""
    parts = [
        """# Document formats

Each stage writes one JSON document. It names its `schema`, the frames it was made from and its
`history`, and it carries what the later stages need. The same input, seed and versions on the same
kind of CPU give the same bytes.

An **array** is nested lists, or, when it is large, an object with the base64 of its little-endian
bytes: `{"dtype": "<f8", "shape": [1510, 2, 2], "base64": "..."}`. Readers accept both. A coordinate
that is unknown, because the point is not visible in that frame, is `null` in a list and NaN in
base64. A document that does not fit its type is refused with the place of the fault:
`expected float, got str at $.tracks.points[3][0][0]`.
"""
    ]
    links = ", ".join(f"[{name}](schemas/{name}.json)" for name in NAMES)
    parts.append(
        f"JSON Schemas: {links}. `mssegment schema NAME` writes the same. With the first line "
        "`# yaml-language-server: $schema=configuration.json` in `config.yaml`, editors complete "
        "and check it.\n"
    )
    parts += [_document_section(schema, kind) for schema, kind in DOCUMENTS.items()]
    parts += [_struct_section(kind) for kind in _structs_below(DOCUMENTS.values())]
    rows = [f"| `{key}` | {kind} | {text} |" for key, (kind, text) in REPORT_FIELDS.items()]
    parts.append(
        "## report.json {#report}\n\nWhat `run` and `report` write for other programs.\n\n"
        "| field | type | meaning |\n|---|---|---|\n" + "\n".join(rows) + "\n"
    )
    return "\n".join(parts)


def field_meaning(kind: type[msgspec.Struct], name: str, hint: Any) -> tuple[str, str]:
    """What a field means, and the shape of its array (empty where it is not stated)."""
    for cls in kind.__mro__:
        if cls.__module__.startswith("mssegment") and name in (own := fields(cls)):
            text, stated = own[name]
            shape = re.search(r"\[[^\]]*\]", stated)
            return text, shape[0] if shape else ""
    records = [record for record in _structs_in(hint) if record.__doc__]
    return summary(records[0]) if records else "", ""


def _document_section(schema: str, kind: type[Document]) -> str:
    return (
        f"## The {kind.kind} document {{#{kind.__name__.lower()}}}\n\n"
        f"Written by `mssegment {kind.made_by}`; schema `{schema}`.\n\n{_struct_body(kind)}"
    )


def _struct_section(kind: type[msgspec.Struct]) -> str:
    return f"### {kind.__name__} {{#{kind.__name__.lower()}}}\n\n{_struct_body(kind)}"


def _struct_body(kind: type[msgspec.Struct]) -> str:
    hints = get_type_hints(kind)
    rows = []
    for field in msgspec.structs.fields(kind):
        meaning, shape = field_meaning(kind, field.name, hints[field.name])
        json_type = _json_type(hints[field.name]).replace("array of", f"array {shape} of")
        rows.append(
            f"| `{field.encode_name}` | {' '.join(json_type.split())} | {_default(field)} | "
            f"{meaning.replace('|', chr(92) + '|')} |"
        )
    table = "| field | type | default | meaning |\n|---|---|---|---|\n" + "\n".join(rows)
    return f"{prose(kind)}\n\n{table}\n"


def _default(field: msgspec.structs.FieldInfo) -> str:
    if field.default_factory is not msgspec.NODEFAULT:
        return f"`{msgspec.json.encode(field.default_factory()).decode()}`"
    if field.default is msgspec.NODEFAULT:
        return "required"
    return f"`{msgspec.json.encode(field.default).decode()}`"


def _json_type(hint: Any) -> str:
    """A type as a reader of JSON knows it; records are links to their own section."""
    origin, arguments = get_origin(hint), get_args(hint)
    if origin in (Union, types.UnionType):
        kinds = [_json_type(part) for part in arguments if part is not types.NoneType]
        return " or ".join([*kinds, "null"] if types.NoneType in arguments else kinds)
    if origin is np.ndarray:
        return f"array of {'integers' if get_args(arguments[1])[0] is np.int64 else 'numbers'}"
    if origin in (list, tuple):
        return f"list of {_json_type(arguments[0])}"
    if origin is dict or hint is dict:
        return "object"
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        return f"[{hint.__name__}](#{hint.__name__.lower()})"
    return {int: "integer", float: "number", str: "string", bool: "boolean"}.get(hint, "any")


def _structs_in(hint: Any) -> Iterator[type[msgspec.Struct]]:
    if isinstance(hint, type) and issubclass(hint, msgspec.Struct):
        yield hint
    for part in get_args(hint):
        yield from _structs_in(part)


def _structs_below(kinds: Any) -> list[type[msgspec.Struct]]:
    """The records inside the documents, each once, in the order in which a reader meets them."""
    found: dict[type[msgspec.Struct], None] = {}
    waiting = list(kinds)
    while waiting:
        for hint in get_type_hints(waiting.pop(0)).values():
            new = [record for record in _structs_in(hint) if record not in found]
            found |= dict.fromkeys(new)
            waiting += new
    return list(found)
