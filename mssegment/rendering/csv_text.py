"""CSV that spreadsheets read without executing it."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence

FORMULA_SIGNS = ("=", "+", "-", "@", "\t", "\r", "\n", "\uff1d", "\uff0b", "\uff0d", "\uff20")
"""A cell that begins with one of these may be run as a formula (OWASP, CSV injection).

The last four are the full-width forms of the first four, which some spreadsheets take for them.
"""
_SKIPPED = " \u00a0\u200b\u2060\ufeff"
"""Blanks and invisible characters that some programs skip at the beginning of a cell."""


def neutral(cell: object) -> object:
    """A cell that no spreadsheet executes: text that could be a formula gets an apostrophe.

    Numbers are left alone, also those in text, and so is a dash that stands for nothing.

    Examples
    --------
    >>> neutral("=1+1"), neutral("-5"), neutral(-5), neutral("-"), neutral("a")
    ("'=1+1", '-5', -5, '-', 'a')
    """
    if not isinstance(cell, str) or cell == "-":
        return cell
    if not cell.lstrip(_SKIPPED).startswith(FORMULA_SIGNS):
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
