"""The JSON documents between the stages: their types, and reading and writing them."""

from __future__ import annotations

from typing import TypeVar

import msgspec

from mssegment.documents.arrays import decode_array, encode_array, readable
from mssegment.documents.files import STANDARD, read_bytes, write_bytes
from mssegment.documents.schemas import (
    DOCUMENTS,
    CornersDocument,
    Document,
    HistoryEntry,
    HypothesesDocument,
    SegmentationDocument,
    TracksDocument,
)
from mssegment.errors import DataError

__all__ = [
    "DOCUMENTS",
    "STANDARD",
    "AnyDocument",
    "CornersDocument",
    "Document",
    "HistoryEntry",
    "HypothesesDocument",
    "SegmentationDocument",
    "TracksDocument",
    "decode",
    "encode",
    "read_bytes",
    "read_document",
    "write_bytes",
    "write_document",
]

AnyDocument = TypeVar("AnyDocument", bound=Document)

_STAGES = ["detect", "match", "hypothesize", "cluster", "report"]


class _Head(msgspec.Struct):
    schema: str


def encode(document: Document) -> bytes:
    """The document as JSON, one line with a line feed at its end."""
    return msgspec.json.encode(document, enc_hook=encode_array) + b"\n"


def decode(content: bytes, kind: type[AnyDocument], name: str = "document") -> AnyDocument:
    """The document of type ``kind`` in ``content``; ``name`` names it in messages.

    Raises DataError, in one line, where it is not JSON, another stage's document, of an unknown
    schema, or not as the schema says.
    """
    try:
        head = msgspec.json.decode(content, type=_Head)
    except msgspec.ValidationError as error:
        raise DataError(
            f"{name}: not a document of mssegment ({readable(error)}); expected one that "
            f"`mssegment {kind.made_by}` writes"
        ) from None
    except msgspec.DecodeError as error:
        raise DataError(f"{name}: {_malformed(content, error)}") from None
    _check_kind(head.schema, kind, name)
    try:
        return msgspec.json.decode(content, type=kind, dec_hook=decode_array)
    except msgspec.ValidationError as error:
        raise DataError(f"{name}: {readable(error)}") from None


def read_document(path: str, kind: type[AnyDocument]) -> AnyDocument:
    """The document in the file, or on standard input for ``-``; raises DataError."""
    return decode(read_bytes(path), kind, "standard input" if path == STANDARD else path)


def write_document(path: str, document: Document) -> None:
    """Writes the document whole or not at all; ``-`` is standard output. Raises UsageError."""
    write_bytes(path, encode(document))


def _malformed(content: bytes, error: msgspec.DecodeError) -> str:
    for literal in (b"NaN", b"Infinity"):
        if literal in content:
            place = content.index(literal)
            return (
                f"{literal.decode()} at byte {place} is not JSON; "
                "write null for a position that is not seen"
            )
    return f"not JSON ({error})"


def _check_kind(schema: str, kind: type[Document], name: str) -> None:
    if DOCUMENTS.get(schema) is kind:
        return
    if schema not in DOCUMENTS:
        known = ", ".join(DOCUMENTS)
        raise DataError(f"{name}: unknown schema {schema!r}, this version reads {known}")
    found = DOCUMENTS[schema]
    start, goal = _STAGES.index(found.made_by) + 1, _STAGES.index(kind.made_by) + 1
    # the stages that still lie between the two, or the later document cannot be turned back
    if start < goal:
        todo = " | ".join(f"mssegment {stage}" for stage in _STAGES[start:goal])
        raise DataError(
            f"{name}: found the {found.kind} document, expected the {kind.kind} document; "
            f"run `{todo}` on it first"
        )
    raise DataError(
        f"{name}: found the {found.kind} document, expected the {kind.kind} document; "
        f"give the one that `mssegment {kind.made_by}` wrote"
    )
