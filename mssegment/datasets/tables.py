"""Tables of text: separators, decimal commas, encodings and headers, found from the content."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import islice

import numpy as np

from mssegment.datasets.table_forms import is_pair, unstacked, with_pairs_parted
from mssegment.errors import DataError
from mssegment.inputs.encodings import text_of
from mssegment.records import Floats

ROW_NAMES = "row name"
"""Name of a first column that the line of names leaves out."""
_SAMPLE = 60
"""Lines from which the separator is determined."""
_SEPARATORS = ("\t", ";", ",", "|", " ")
_COMMENTS = ("#", "%", "//")
_MISSING = frozenset({"", "nan", "na", "n/a", "none", "null", "-nan", "nil", "<na>", "-"})
"""Cells that stand for no value, in lower case."""
_NUMBER = re.compile(r"[-+]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][-+]?\d+)?")


class Table(Mapping[str, Sequence[str]]):
    """Columns of text by name, in lower case.

    Parameters
    ----------
    name : str
        The name of the file, for errors.
    columns : mapping of str to sequence of str
        The cells of each column; ``1``, ``2``, ... are the names where the file has none.
    lines : sequence of int
        The line of each row in the file.
    has_header : bool
        Whether the file names its columns.
    """

    def __init__(
        self,
        name: str,
        columns: Mapping[str, Sequence[str]],
        lines: Sequence[int],
        has_header: bool = True,
    ) -> None:
        self.name = name
        self.has_header = has_header
        self.lines = lines
        self._columns = dict(columns)

    def __getitem__(self, name: str) -> Sequence[str]:
        """The cells of a column."""
        return self._columns[name]

    def __iter__(self) -> Iterator[str]:
        """The names of the columns, in their order."""
        return iter(self._columns)

    def __len__(self) -> int:
        """The number of columns."""
        return len(self._columns)

    @property
    def rows(self) -> int:
        """The number of rows."""
        return len(self.lines)

    def numbers(self, name: str) -> Floats:
        """A column as float64 [rows], NaN for an empty cell and for ``nan``, ``NA``, ``null``.

        Raises DataError for any other cell that is no finite number; with the line.
        """
        cells = self._columns[name]
        try:
            values = np.array(cells, dtype=np.float64)
        except ValueError:
            values = np.array([number_of(cell) for cell in cells], dtype=np.float64)
        for row in np.flatnonzero(~np.isfinite(values)).tolist():
            if not is_missing(cells[row]):
                raise DataError(
                    f"{self.name}: line {self.lines[row]}: '{cells[row].strip()}' in column "
                    f"'{name}'; expected a number"
                )
        return values

    def is_numeric(self, name: str) -> bool:
        """Whether every cell of a column is a finite number or missing, and one is a number."""
        cells = [cell for cell in self._columns[name] if not is_missing(cell)]
        return bool(cells) and all(np.isfinite(number_of(cell)) for cell in cells)

    def without(self, rows: Sequence[int]) -> Table:
        """The table without some rows."""
        gone = set(rows)
        kept = [i for i in range(self.rows) if i not in gone]
        columns = {name: [cells[i] for i in kept] for name, cells in self._columns.items()}
        return Table(self.name, columns, [self.lines[i] for i in kept], self.has_header)

    def renamed(self, names: Sequence[str]) -> Table:
        """The table with other names of its columns, in their order."""
        columns = dict(zip(names, self._columns.values(), strict=True))
        return Table(self.name, columns, self.lines)


def is_missing(cell: str) -> bool:
    """Whether a cell stands for no value."""
    return cell.strip().lower() in _MISSING


def number_of(cell: str) -> float:
    """A cell as a number, with a decimal point or a decimal comma; NaN if it is none."""
    text = cell.strip()
    if "," in text:
        # with a point as well, the commas part thousands
        text = text.replace(",", "") if "." in text else text.replace(",", ".")
    try:
        return float(text)
    except ValueError:
        return float("nan")


def read_table(content: bytes, name: str) -> Table:
    """Read a table of text.

    Parameters
    ----------
    content : bytes
        The file. Fields are parted by commas, semicolons, tabs, bars or blanks; a comma may be the
        decimal separator where it parts no fields. Lines that begin with ``#`` or ``%`` are
        comments, the last one before the rows may name the columns. Without names every cell of
        the first row is a number.
    name : str
        The name of the file, for errors.

    Returns
    -------
    Table

    Raises
    ------
    DataError
        If the file is empty, is no table, or a row has another number of fields.
    """
    text = text_of(content, name)
    try:
        separator, lines, comment = _lines_of(text)
        rows = list(_rows(lines, separator))
    except csv.Error as error:
        raise DataError(
            f"{name}: not a table ({error}); expected one with lines such as x1,y1,x2,y2"
        ) from None
    if not rows:
        raise DataError(f"{name}: empty; expected a table of tracks, such as x1,y1,x2,y2")
    if comment is not None and _is_data(rows[0][1]):
        named = next(_rows([comment], separator), (0, []))[1]
        if len(named) != len(rows[0][1]):
            named = comment[1].replace(",", " ").split()
        if len(named) == len(rows[0][1]):
            rows.insert(0, (comment[0], named))
    rows = unstacked(_without_preamble(rows))
    has_header = not _is_data(rows[0][1])
    first = rows[0][1]
    names = [cell.strip().lower() for cell in first] if has_header else _numbered(len(first))
    body = rows[1:] if has_header else rows
    names = _without_trailing(names, body)
    if has_header and body and all(len(row) == len(names) + 1 for _, row in body):
        names = [ROW_NAMES, *names]  # as R writes them
    for number, row in body:
        if len(row) != len(names):
            raise DataError(f"{name}: line {number}: {len(row)} fields; expected {len(names)}")
    names = _checked_names(names, body, name, rows[0][0])
    columns = with_pairs_parted({own: [row[i] for _, row in body] for i, own in enumerate(names)})
    return Table(name, columns, [number for number, _ in body], has_header)


def _lines_of(text: str) -> tuple[str, list[tuple[int, str]], tuple[int, str] | None]:
    """The separator, the lines with their numbers, and the last comment before the rows."""
    stated, comment = "", None
    lines: list[tuple[int, str]] = []
    for number, line in enumerate(io.StringIO(text, newline=None), 1):
        line = line.rstrip("\n\r\0")
        if not line.strip():
            continue
        if not lines and (match := re.fullmatch(r'"?sep=(.)"?', line.strip("\ufeff "))):
            stated = match[1]  # Excel's own line
        elif line.lstrip().startswith(_COMMENTS):
            if not lines:
                comment = number, line.lstrip().lstrip("#%/").strip()
        else:
            lines.append((number, line))
    return stated or _separator([line for _, line in lines]), lines, comment


def _rows(lines: Sequence[tuple[int, str]], separator: str) -> Iterator[tuple[int, list[str]]]:
    texts = [line for _, line in lines]
    if separator == " ":
        rows: Iterable[list[str]] = (line.split() for line in texts)
    elif any('"' in line for line in texts):
        # line by line: a quotation mark that is not closed must not swallow the file
        rows = (next(_parsed([line], separator)) for line in texts)
    else:
        rows = _parsed(texts, separator)
    for (number, _), row in zip(lines, rows, strict=True):
        if any(map(str.strip, row)):
            yield number, row


def _parsed(lines: Sequence[str], separator: str) -> Iterator[list[str]]:
    return csv.reader(lines, delimiter=separator, skipinitialspace=True)


def _separator(lines: Sequence[str]) -> str:
    """The separator that parts most sampled lines into the same number of fields, all numbers."""
    sample = list(islice(lines, _SAMPLE))
    best, most = ",", (-1.0, -1)
    # beside tabs, semicolons and bars, commas are those of numbers
    certain = [own for own in "\t;|" if sample and all(own in line for line in sample)]
    for separator in certain or _SEPARATORS:
        rows = [
            line.split() if separator == " " else next(_parsed([line], separator), [])
            for line in sample
        ]
        counts = [len(row) for row in rows]
        usual = max(set(counts), key=counts.count) if counts else 0
        if usual < 2:
            continue
        cells = [cell for row in rows for cell in row if cell.strip()]
        good = sum(_reads_as_number(cell) or is_pair(cell) for cell in cells) / max(len(cells), 1)
        score = good * counts.count(usual) / len(counts), usual
        if score > most:
            best, most = separator, score
    return best


def _reads_as_number(cell: str) -> bool:
    return is_missing(cell) or _NUMBER.fullmatch(cell.strip()) is not None


def _is_data(row: Sequence[str]) -> bool:
    """Whether a row holds numbers rather than names: most of its cells do, and the first two."""
    good = [_reads_as_number(cell) or cell.strip().lower() in ("inf", "-inf") for cell in row]
    return sum(good) * 2 > len(row)


def _without_preamble(rows: list[tuple[int, list[str]]]) -> list[tuple[int, list[str]]]:
    """The rows without lines of a single cell above the table, such as its title."""
    start = next((i for i, (_, row) in enumerate(rows[:_SAMPLE]) if sum(map(bool, row)) > 1), 0)
    return rows[start:]


def _numbered(count: int) -> list[str]:
    return [str(i + 1) for i in range(count)]


def _without_trailing(names: list[str], body: list[tuple[int, list[str]]]) -> list[str]:
    """Drop a last column without a name and without values: lines that end with a separator."""
    last = len(names) - 1
    if last > 0 and not names[last] and all(not any(r[last:]) for _, r in body):
        for _, row in body:
            del row[last:]
        return names[:last]
    return names


def _checked_names(
    names: list[str], body: list[tuple[int, list[str]]], path: str, line: int
) -> list[str]:
    """Number empty names, and keep one of two equal columns, such as an index that pandas repeats.

    Raises DataError for a name of two columns that differ.
    """
    names = [name or f"column {i + 1}" for i, name in enumerate(names)]
    repeated = [i for i, name in enumerate(names) if name in names[:i]]
    for i in repeated:
        first = names.index(names[i])
        if any(row[i] != row[first] for _, row in body):
            raise DataError(
                f"{path}: line {line}: two columns have the same name '{names[i]}'; rename one"
            )
    if repeated:
        for _, row in body:
            row[:] = [cell for i, cell in enumerate(row) if i not in repeated]
    return [name for i, name in enumerate(names) if i not in repeated]
