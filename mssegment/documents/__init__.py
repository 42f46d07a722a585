"""The JSON documents that the stages exchange: their types, and how to read and write them."""

from __future__ import annotations

import os
from typing import TypeVar

import msgspec

from mssegment.documents.arrays import decode_array, encode_array, readable
from mssegment.documents.checks import check_texts
from mssegment.documents.earlier import upgraded
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
    """Serialize a document as JSON: one line, ending with a line feed."""
    return msgspec.json.encode(document, enc_hook=encode_array) + b"\n"


def decode(content: bytes, kind: type[AnyDocument], name: str = "document") -> AnyDocument:
    """Parse and validate a document.

    Parameters
    ----------
    content : bytes
        The JSON text.
    kind : type
        The expected type of document.
    name : str
        The name of the document in error messages, usually its path.

    Returns
    -------
    Document
        An instance of ``kind``.

    Raises
    ------
    DataError
        If the content is not JSON, has an unknown schema, is the document of another stage, or
        violates its schema. The message is one line that starts with ``name``.
    """
    try:
        head = msgspec.json.decode(content, type=_Head)
        earlier = upgraded(content, head.schema)
        if earlier is None:
            _check_kind(head.schema, kind, name)
        else:
            content = earlier
            _check_kind(f"{head.schema.rpartition('/')[0]}/2", kind, name)
        document = msgspec.json.decode(content, type=kind, dec_hook=decode_array)
        check_texts(document)
    except msgspec.ValidationError as error:
        if "schema" in str(error) or b'"mssegment/' not in content:
            raise DataError(
                f"{name}: not an mssegment document ({readable(error)}); expected one written by "
                f"`mssegment {kind.made_by}`"
            ) from None
        raise DataError(f"{name}: {readable(error)}") from None
    except msgspec.DecodeError as error:
        raise DataError(f"{name}: {_malformed(content, error)}") from None
    except ValueError as error:
        raise DataError(f"{name}: {error}") from None
    except RecursionError:
        raise DataError(f"{name}: nested too deeply for a {kind.kind} document") from None
    except MemoryError:
        raise DataError(f"{name}: there is not enough memory to read it") from None
    return document


def read_document(path: str, kind: type[AnyDocument]) -> AnyDocument:
    """Read a document from a file, or from standard input if ``path`` is ``-``.

    Of a folder of results, which has a document of each stage, it is the one of this kind. Raises
    DataError if it cannot be read, or for the reasons that ``decode`` lists.
    """
    inside = os.path.join(path, f"{kind.kind}.json")
    if path != STANDARD and os.path.isfile(inside):
        path = inside
    return decode(read_bytes(path), kind, "standard input" if path == STANDARD else path)


def write_document(path: str, document: Document) -> None:
    """Write a document to a file, or to standard output if ``path`` is ``-``.

    The file is replaced atomically. Raises UsageError if it cannot be written.
    """
    write_bytes(path, encode(document))


def _malformed(content: bytes, error: msgspec.DecodeError) -> str:
    if not content.removeprefix(b"\xef\xbb\xbf").lstrip().startswith((b"{", b"[")):
        return (
            "no document of mssegment, which is JSON; `mssegment detect` makes one of pictures, "
            "and `mssegment import` of tracks"
        )
    for literal in (b"NaN", b"Infinity"):
        if literal in content:
            place = content.index(literal)
            return (
                f"{literal.decode()} at byte {place} is not JSON; "
                "write null where the point is not visible in that frame"
            )
    return f"not JSON ({error})"


def _check_kind(schema: str, kind: type[Document], name: str) -> None:
    if DOCUMENTS.get(schema) is kind:
        return
    stem, _, number = schema.rpartition("/")
    newest = next((own for own in DOCUMENTS if own.startswith(f"{stem}/")), None)
    if schema not in DOCUMENTS and newest is not None and number.isdecimal():
        age = "an earlier" if int(number) < int(newest.rpartition("/")[2]) else "a later"
        raise DataError(
            f"{name}: written by {age} version of mssegment (schema {schema}; this one reads "
            f"{newest}); run `mssegment {DOCUMENTS[newest].made_by}` of this version again"
        )
    if schema not in DOCUMENTS:
        known = ", ".join(DOCUMENTS)
        raise DataError(f"{name}: unknown schema {schema!r}; this version reads {known}")
    found = DOCUMENTS[schema]
    start, goal = _STAGES.index(found.made_by) + 1, _STAGES.index(kind.made_by) + 1
    # name the stages in between; the document of a later stage cannot be turned back
    if start < goal:
        todo = " | ".join(f"mssegment {stage}" for stage in _STAGES[start:goal])
        raise DataError(
            f"{name}: found a {found.kind} document; expected a {kind.kind} document: "
            f"run `{todo}` on it first"
        )
    raise DataError(
        f"{name}: found a {found.kind} document; expected a {kind.kind} document: "
        f"use the one written by `mssegment {kind.made_by}`"
    )
