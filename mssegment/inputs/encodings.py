"""Text in the encodings that programs and spreadsheets write."""

from __future__ import annotations

from mssegment.errors import DataError
from mssegment.inputs import limits

_BYTE_ORDER_MARKS = {
    b"\xef\xbb\xbf": "utf-8-sig",
    b"\xff\xfe\0\0": "utf-32",
    b"\0\0\xfe\xff": "utf-32",
    b"\xff\xfe": "utf-16",
    b"\xfe\xff": "utf-16",
}


def text_of(content: bytes, name: str) -> str:
    """Decode a file of text: by its byte order mark, as UTF-8, as UTF-16, or as Windows-1252.

    Raises DataError if the content is binary.
    """
    limits.check("text_bytes", len(content), name)
    for mark, encoding in _BYTE_ORDER_MARKS.items():
        if content.startswith(mark):
            return _decoded(content, encoding, name)
    head = content[:1000]
    if head.count(b"\0") > len(head) // 4:
        even = head[::2].count(b"\0") > head[1::2].count(b"\0")
        return _decoded(content, "utf-16-be" if even else "utf-16-le", name)
    if b"\0" in head:
        raise DataError(f"{name}: a binary file of an unknown kind; expected tracks")
    try:
        return content.decode("utf-8")
    except UnicodeDecodeError:
        # spreadsheets on older systems; only names and notes have such letters
        return content.decode("cp1252", errors="replace")


def _decoded(content: bytes, encoding: str, name: str) -> str:
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        raise DataError(f"{name}: damaged text ({error.reason}); export the table again") from None
