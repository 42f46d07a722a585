"""How fast it is, as ratios measured side by side: ``python -m benchmarks.speed [--json] [WORD]``.

Every figure is a ratio of CPU times in one run, medians of interleaved runs, one BLAS thread. A
WORD picks the suites whose name contains it. A new suite is a function that yields rows, and one
line in ``SUITES``; what takes whole processes can use ``timing.command_seconds``.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator

from benchmarks import speed_commands, speed_estimator, speed_large, speed_peers
from benchmarks.timing import Row, Rows

SUITES: dict[str, Rows] = {
    "estimator": speed_estimator.rows,
    "large": speed_large.rows,
    "peers": speed_peers.rows,
    "commands": speed_commands.rows,
}


def measured(word: str) -> Iterator[Row]:
    """The rows of the suites whose name contains ``word``, as they come."""
    for name, rows in SUITES.items():
        if word in name:
            yield from rows()


def as_line(row: Row) -> str:
    """One line of the table."""
    if row.ratio is None:
        return f"{row.name:<72} skipped: {row.note}"
    sign = ">=" if row.more else "<="
    verdict = "ok" if row.holds else "FALLS SHORT"
    return f"{row.name:<72} {row.ratio:>9.4g} {sign} {row.goal:<7g} {verdict}  {row.note}".rstrip()


def main() -> None:
    """Print the table, or with ``--json`` a list of {name, ratio, goal, holds}."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("word", nargs="?", default="", help="only suites with this in their name")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    arguments = parser.parse_args()
    found = []
    for row in measured(arguments.word):
        found.append(row)
        if not arguments.json:
            print(as_line(row), flush=True)
    if arguments.json:
        keys = ("name", "ratio", "goal", "holds", "note")
        print(json.dumps([{key: getattr(row, key) for key in keys} for row in found], indent=1))


if __name__ == "__main__":
    main()
