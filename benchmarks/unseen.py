"""Data that nobody tuned to: ``python -m benchmarks.unseen [sequences|two-views]``.

Published data sets as they are and changed in many ways, where they are at hand, and random
physical scenes whose true motions are known. The goals stand beside the figures: on the data at
hand, and on data that is not; the oracle is the misclassification of one who knows every true
motion. Choose constants on some seeds, and report others: ``--seeds 0:3``, then ``--seeds 3:6``;
with several seeds the least and the largest mean of a seed stand behind the error.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict

import numpy as np

from benchmarks import unseen_sequences, unseen_two_views
from benchmarks.data import data_folder
from benchmarks.unseen_rows import Outcome, Plan, Row, chosen

TABLES = {"sequences": unseen_sequences.ROWS, "two-views": unseen_two_views.ROWS}
CLASSES = {
    "outliers": (0.0, 0.2, 0.4, 0.6),
    "noise": (0.0, 0.3, 0.7, 1.2),
    "tracks": (60, 200, 600),
    "turning": (5, 15, 40),
    "perspective": (0.0, 0.1, 0.3, 1.0),
}
"""Largest values of the classes of a factor; the values of other factors stand by themselves."""
HEADER = (
    "| row | | runs | error | oracle | count right | right | CPU s | goal | goal, unseen |\n"
    "|---|---|---|---|---|---|---|---|---|---|"
)
FACTOR_HEADER = (
    "| {} | | runs | error | oracle | count right | right |\n|---|---|---|---|---|---|---|"
)
Found = list[Outcome] | str
"""The outcomes of a row, or why it was skipped."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the rows that are asked for; prints tables, or JSON."""
    parser = _parser()
    options = parser.parse_args(arguments)
    plan = Plan(options.seeds, options.scenes, data_folder())
    tables = [options.table] if options.table else list(TABLES)
    try:
        wanted = chosen([row for table in tables for row in TABLES[table]], options.rows)
    except ValueError as error:
        parser.error(str(error))
    results: dict[str, dict[str, Found]] = {}
    for table in tables:
        rows = [row for row in TABLES[table] if row in wanted]
        if rows:
            results[table] = run(table, rows, plan, quiet=options.json)
    if options.json:
        print(json.dumps(as_json(results), indent=1))


def run(table: str, rows: Sequence[Row], plan: Plan, *, quiet: bool) -> dict[str, Found]:
    """The outcomes of each row, printed as they come unless ``quiet``."""
    found: dict[str, Found] = {}
    if not quiet:
        print(f"\n## {table}\n\n{HEADER}", flush=True)
    for row in rows:
        print(f"{table}: {row.title}", file=sys.stderr, flush=True)
        found[row.name] = row.missing(plan) or list(row.outcomes(plan))
        if not quiet:
            print("\n".join(lines_of(row, found[row.name])), flush=True)
    if not quiet:
        print("\n".join(factor_tables(rows, found)), flush=True)
    return found


def lines_of(row: Row, found: Found) -> list[str]:
    """The lines of a row: one for each cell, the goals on the first, and one for all cells."""
    name = f"{row.title} (`{row.name}`)"
    if isinstance(found, str):
        return [f"| {name} | | skipped: {found} | | | | | | {row.goal} | {row.unseen} |"]
    cells = list(dict.fromkeys(outcome.cell for outcome in found))
    groups = {cell: [o for o in found if o.cell == cell] for cell in cells}
    if len(cells) > 1:
        groups = {"all": found, **groups}
    lines: list[str] = []
    for cell, members in groups.items():
        seconds = np.mean([outcome.seconds for outcome in members])
        goals = f"{row.goal} | {row.unseen}" if not lines else " | "
        lines.append(
            f"| {name if not lines else ''} | {cell} | {_figures(members)} | {seconds:.2f} "
            f"| {goals} |"
        )
    return lines


def factor_tables(rows: Sequence[Row], found: dict[str, Found]) -> list[str]:
    """A table by factor for each group of rows, of the factors that vary in it."""
    lines: list[str] = []
    for group in dict.fromkeys(row.group for row in rows if row.group):
        outcomes: list[Outcome] = []
        for row in rows:
            own = found[row.name]
            if row.group == group and not isinstance(own, str):
                outcomes += own
        lines += ["", FACTOR_HEADER.format(group)]
        for factor in outcomes[0].factors if outcomes else ():
            classes = by_class(factor, outcomes)
            if len(classes) > 1:
                lines += [f"| {factor} | {c} | {_figures(own)} |" for c, own in classes.items()]
    return lines


def by_class(factor: str, outcomes: Sequence[Outcome]) -> dict[str, list[Outcome]]:
    """The outcomes by the class of a factor, from small to large."""
    edges = CLASSES.get(factor, ())
    classes: dict[tuple[float, str], list[Outcome]] = {}
    for outcome in outcomes:
        value = outcome.factors[factor]
        if isinstance(value, str):
            key = (0.0, value)
        elif edges:
            above = int(np.searchsorted(edges, value))
            key = (float(above), _class(edges, above))
        else:
            key = (float(value), f"{value:g}")
        classes.setdefault(key, []).append(outcome)
    return {label: classes[order, label] for order, label in sorted(classes)}


def _class(edges: Sequence[float], above: int) -> str:
    """The name of a class of a factor by the number of edges below it."""
    if above == len(edges):
        return f"> {edges[-1]:g}"
    return f"<= {edges[above]:g}" if edges[above] > 0 else "0"


def as_json(results: dict[str, dict[str, Found]]) -> dict[str, object]:
    """All outcomes by table and row; NaN, which JSON does not have, is null."""
    rows = {row.name: row for table in results for row in TABLES[table]}
    return {
        table: {
            name: {
                "title": rows[name].title,
                "goal": rows[name].goal,
                "goal_unseen": rows[name].unseen,
                **({"skipped": own} if isinstance(own, str) else _summary(own)),
            }
            for name, own in found.items()
        }
        for table, found in results.items()
    }


def _summary(outcomes: Sequence[Outcome]) -> dict[str, object]:
    means = {
        "error": _mean(outcomes, lambda o: o.error),
        "oracle": _mean(outcomes, lambda o: o.oracle),
        "count_right": _mean(outcomes, lambda o: o.count_right),
        "right": _mean(outcomes, lambda o: o.right),
        "seconds": _mean(outcomes, lambda o: o.seconds),
    }
    runs = [asdict(outcome) for outcome in outcomes]
    for one in runs:
        one["oracle"] = None if np.isnan(one["oracle"]) else one["oracle"]
    return {"runs": len(outcomes), **means, "outcomes": runs}


def _figures(outcomes: Sequence[Outcome]) -> str:
    """Cells of a table: runs, error, oracle, share of right counts and of right cases.

    A case is right if its count is, and its error at most 5 points above the oracle's (or 0).
    """
    refused = sum(bool(outcome.refused) for outcome in outcomes)
    runs = f"{len(outcomes)}" + (f" ({refused} refused)" if refused else "")
    oracle = _mean(outcomes, lambda o: o.oracle)
    return (
        f"{runs} | {_mean(outcomes, lambda o: o.error):.2%}{_between_seeds(outcomes)} "
        f"| {'' if oracle is None else f'{oracle:.2%}'} "
        f"| {_mean(outcomes, lambda o: o.count_right):.0%} "
        f"| {_mean(outcomes, lambda o: o.right):.0%}"
    )


def _between_seeds(outcomes: Sequence[Outcome]) -> str:
    """The least and the largest mean error of a seed, where there are several seeds."""
    seeds = {outcome.seed for outcome in outcomes}
    means = [np.mean([o.error for o in outcomes if o.seed == seed]) for seed in seeds]
    return f" ({min(means):.2%} to {max(means):.2%})" if len(means) > 1 else ""


def _mean(outcomes: Sequence[Outcome], value: Callable[[Outcome], float]) -> float | None:
    mean = float(np.mean([value(outcome) for outcome in outcomes])) if outcomes else np.nan
    return None if np.isnan(mean) else mean


def _seeds(text: str) -> range:
    """``A:B``: the seeds from A to before B; ``B``: from 0."""
    first, _, last = text.rpartition(":")
    found = range(int(first or 0), int(last))
    if not found or found.start < 0:
        raise ValueError(text)
    return found


def _parser() -> argparse.ArgumentParser:
    names = {table: ", ".join(row.name for row in rows) for table, rows in TABLES.items()}
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.unseen",
        description=__doc__,
        epilog="\n\n".join(f"rows of {table}: {rows}" for table, rows in names.items()),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("table", nargs="?", choices=list(TABLES), help="default: both")
    parser.add_argument(
        "--seeds", type=_seeds, default=range(1), metavar="A:B", help="seeds A to B - 1 (0:1)"
    )
    parser.add_argument(
        "--scenes", type=int, default=30, metavar="N", help="scenes of a row for each seed (30)"
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")
    parser.add_argument(
        "--rows", nargs="+", default=[], metavar="NAME", help="rows whose names begin so"
    )
    return parser


if __name__ == "__main__":
    main()
