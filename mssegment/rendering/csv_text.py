"""CSV that spreadsheets read without executing it."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence

FORMULA_SIGNS = ("=", "+", "-", "@", "\t", "\r")
"""A cell that begins with one of these may be run as a formula (OWASP, CSV injection)."""


def neutral(cell: object) -> object:
    """A cell that no spreadsheet executes: text that could be a formula gets an apostrophe.

    Numbers are left alone, also those in text, and so is a dash that stands for nothing.

    Examples
    --------
    >>> neutral("=1+1"), neutral("-5"), neutral(-5), neutral("-"), neutral("a")
    ("'=1+1", '-5', -5, '-', 'a')
    """
    if not isinstance(cell, str) or not cell.startswith(FORMULA_SIGNS) or cell == "-":
        return cell
    try:
        float(cell)
    except ValueError:
        return f"'{cell}"
    return cell


def csv_bytes(header: Sequence[str], rows: Iterable[Sequence[object]]) -> bytes:
    """A table as UTF-8 CSV, with neutral cells."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    writer.writerows([[neutral(cell) for cell in row] for row in rows])
    return out.getvalue().encode()
