"""The lists of docs/constants.md: the constants of the method on sequences, from the code."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "mssegment"
LISTED = (
    "sampling/chimeras.py",
    "sampling/validation.py",
    "sampling/windows.py",
    "sampling/frame_pairs.py",
    "segmentation/consensus/*.py",
    "sequences/*.py",
    "geometry/flats.py",
    "geometry/incomplete_flats.py",
    "geometry/projective_flats.py",
    "geometry/robust_epipolar.py",
)
BEGIN, END = "<!-- constants: begin -->", "<!-- constants: end -->"


def constants_of(source: str) -> Iterator[tuple[str, str, str]]:
    """Names, values and meanings of the numeric constants of a module."""
    body = ast.parse(source).body
    for statement, after in pairwise([*body, ast.Pass()]):
        if not isinstance(statement, ast.Assign):
            continue
        name = ast.unparse(statement.targets[0]).strip("()")
        if name.upper() != name or not _is_numeric(statement.value):
            continue
        meaning = ""
        if isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant):
            meaning = " ".join(str(after.value.value).split())
        yield name, ast.unparse(statement.value).strip("()"), meaning


def _is_numeric(value: ast.expr) -> bool:
    """Whether an expression holds numbers and no text, call or name."""
    allowed = (ast.Constant, ast.Tuple, ast.Dict, ast.BinOp, ast.UnaryOp)
    parts = [node for node in ast.walk(value) if isinstance(node, ast.expr)]
    return all(
        isinstance(node, allowed)
        and not (isinstance(node, ast.Constant) and isinstance(node.value, str))
        for node in parts
    )


def constants_lists() -> str:
    """A table of the constants of each module that has any."""
    parts = []
    for path in sorted(path for pattern in LISTED for path in PACKAGE.glob(pattern)):
        rows = list(constants_of(path.read_text(encoding="utf-8")))
        if rows:
            module = path.relative_to(PACKAGE).with_suffix("").as_posix().replace("/", ".")
            parts += [f"### `{module}`\n", "| constant | value | meaning |", "|---|---|---|"]
            parts += [f"| `{name}` | `{value}` | {_cell(text)} |" for name, value, text in rows]
            parts.append("")
    return "\n".join(parts)


def _cell(text: str) -> str:
    """Text in a cell of a table; names in code as Markdown has them."""
    return text.replace("``", "`").replace("|", "\\|")


def page_with_lists(text: str) -> str:
    """docs/constants.md with its generated part replaced."""
    before, rest = text.split(BEGIN)
    return f"{before}{BEGIN}\n{constants_lists()}\n{END}{rest.split(END)[1]}"
