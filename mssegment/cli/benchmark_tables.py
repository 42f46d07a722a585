"""The results of ``mssegment benchmark`` as text and as JSON."""

from __future__ import annotations

import json
from collections.abc import Sequence

from msgspec.structs import asdict

from mssegment.benchmarking import SequenceResult, summarise
from mssegment.registry import DATASETS
from mssegment.rendering.tables import Table, format_table


def benchmark_json(dataset: str, results: Sequence[SequenceResult]) -> str:
    """The results as JSON.

    ``sequences`` has one entry per sequence and seed, ``groups`` one per group and ``all``.
    """
    groups = {name: asdict(group) for name, group in summarise(results).items()}
    sequences = [asdict(result) for result in results]
    content = {"dataset": dataset, "sequences": sequences, "groups": groups}
    return json.dumps(content, indent=1) + "\n"


def benchmark_text(dataset: str, results: Sequence[SequenceResult]) -> str:
    """Tables per sequence (mean over the seeds), per group, and of published results."""
    parts = [
        format_table(table, "text")
        for table in (_sequences(results), _groups(results), _published(dataset))
    ]
    return "\n".join(parts)


def _sequences(results: Sequence[SequenceResult]) -> Table:
    by_name: dict[str, list[SequenceResult]] = {}
    for result in results:
        by_name.setdefault(result.name, []).append(result)
    rows = []
    for name, own in by_name.items():
        found = ", ".join(str(n) for n in sorted({result.motions_found for result in own}))
        error = sum(result.error for result in own) / len(own)
        seconds = sum(result.seconds for result in own) / len(own)
        true = str(own[0].motions_true)
        rows.append((name, own[0].group, true, found, f"{error:.2%}", f"{seconds:.2f}"))
    header = ("sequence", "group", "true motions", "found motions", "error", "seconds")
    return Table("Sequences", header, tuple(rows))


def _groups(results: Sequence[SequenceResult]) -> Table:
    rows = tuple(
        (
            name,
            str(group.sequences),
            f"{group.mean:.2%}",
            f"{group.median:.2%}",
            f"{group.count_right:.1%}",
            f"{group.seconds:.2f}",
        )
        for name, group in summarise(results).items()
    )
    header = ("group", "sequences", "mean error", "median error", "correct count", "seconds")
    return Table("Groups", header, rows)


def _published(dataset: str) -> Table:
    rows = tuple(
        (entry.method, entry.group, f"{entry.mean} %", entry.source)
        for entry in DATASETS[dataset].benchmark.published
    )
    return Table("Published results", ("published method", "group", "mean error", "source"), rows)
