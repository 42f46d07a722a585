"""JSON Schemas of the documents, of report.json and of the configuration, from their types."""

from __future__ import annotations

from typing import Any, get_args, get_origin

import msgspec
import numpy as np

from mssegment.configuration import Configuration
from mssegment.documents import DOCUMENTS

DIALECT = "https://json-schema.org/draft/2020-12/schema"
_KINDS = {kind.kind: kind for kind in DOCUMENTS.values()}
NAMES = (*_KINDS, "report", "configuration")
"""What has a schema."""

_NUMBERS: dict[str, Any] = {"type": "array", "items": {"type": ["number", "null"]}}
_OBJECTS: dict[str, Any] = {"type": "array", "items": {"type": "object"}}
_INTEGERS: dict[str, Any] = {"type": "array", "items": {"type": "integer"}}
_COUNT: dict[str, Any] = {"type": "integer", "minimum": 0}


def _or_null(kind: dict[str, Any]) -> dict[str, Any]:
    return {"anyOf": [kind, {"type": "null"}]}


REPORT: dict[str, dict[str, Any]] = {
    "schema": {"const": "mssegment/report/1"},
    "motions": _COUNT,
    "misclassification": _or_null({"type": "number", "minimum": 0, "maximum": 1}),
    "confusion": _or_null({"type": "array", "items": _INTEGERS}),
    "modes": _OBJECTS,
    "res": _or_null(_NUMBERS),
    "res_hat": _or_null(_NUMBERS),
    "tracks": _COUNT,
    "outliers": _COUNT,
    "background": _COUNT,
    "not_judged": _COUNT,
    "labels": _INTEGERS,
    "true_labels": _or_null(_INTEGERS),
    "motion_list": _OBJECTS,
    "notes": {"type": "array", "items": {"type": "string"}},
    "frames": _OBJECTS,
    "history": _OBJECTS,
}
"""The keys of report.json that other programs may rely on; there are more."""


def json_schema(name: str) -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of what is called ``name``, one of ``NAMES``.

    It is what the reader of the program checks, but for the sizes of arrays, which depend on each
    other. Raises KeyError for another name.

    Examples
    --------
    >>> json_schema("configuration")["properties"]["seed"]["minimum"]
    0
    """
    if name == "report":
        body: dict[str, Any] = {
            "title": "report",
            "description": "What `run` and `report` write for other programs.",
            "type": "object",
            "properties": REPORT,
            "required": list(REPORT),
        }
        return {"$schema": DIALECT, **body}
    kind = Configuration if name == "configuration" else _KINDS[name]
    made = msgspec.json.schema(kind, schema_hook=_array)
    definitions = made["$defs"]
    top = definitions.pop(kind.__name__)
    for record in [top, *definitions.values()] if name == "configuration" else []:
        if "properties" in record:
            record["additionalProperties"] = False  # an unknown key is an error
    return {"$schema": DIALECT, **top, "title": name, "$defs": definitions}


def _array(kind: type) -> dict[str, Any]:
    """An array: nested lists, or the base64 of its bytes."""
    if get_origin(kind) is not np.ndarray and kind is not np.ndarray:
        raise NotImplementedError(kind)
    arguments = get_args(kind)
    whole = len(arguments) > 1 and get_args(arguments[1])[:1] == (np.int64,)
    encoded = {
        "type": "object",
        "properties": {
            "dtype": {"enum": ["<i8"] if whole else ["<f8", "<i8"]},
            "shape": _INTEGERS,
            "base64": {"type": "string", "contentEncoding": "base64"},
        },
        "required": ["dtype", "shape", "base64"],
        "additionalProperties": False,
    }
    item = "integer" if whole else "number"
    nested = {"type": "array", "items": {"type": ["array", item, "null"]}}
    return {"anyOf": [nested, encoded]}
