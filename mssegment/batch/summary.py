"""The summary of a batch: a table, JSON, and an HTML index that links the pages of the items."""

from __future__ import annotations

import base64
import hashlib
from collections import Counter
from collections.abc import Sequence
from html import escape
from importlib import resources
from pathlib import Path
from string import Template
from urllib.parse import quote

import msgspec

from mssegment.batch import Result
from mssegment.documents import write_bytes
from mssegment.rendering.tables import Table, fixed
from mssegment.version import __version__

INDEX, SUMMARY = "index.html", "summary.json"


def write_summary(results: Sequence[Result], out: str) -> list[str]:
    """Write the summary and the index into the folder of the batch; the names of the files."""
    write_bytes(str(Path(out) / SUMMARY), summary_bytes(results))
    write_bytes(str(Path(out) / INDEX), index_page(results).encode("utf-8", "replace"))
    return [SUMMARY, INDEX]


def summary_bytes(results: Sequence[Result]) -> bytes:
    """The summary as JSON; equal for equal results, whenever and by whomever they were made."""
    content = {
        "schema": "mssegment/batch/1",
        "version": __version__,
        "items": [
            {
                "name": result.item.name,
                "origin": result.item.origin,
                "state": _state(result),
                "error": result.error or None,
                "found": None if result.facts is None else msgspec.to_builtins(result.facts),
            }
            for result in results
        ],
    }
    return msgspec.json.format(msgspec.json.encode(content), indent=1) + b"\n"


def _state(result: Result) -> str:
    """The state without what only this run of the batch knows."""
    if result.has_failed:
        return "failed"
    return result.state if result.facts is None else "done"


def summary_table(results: Sequence[Result]) -> Table:
    """One row for each item: what was found, or that it failed."""
    with_truth = any(r.facts is not None and r.facts.misclassification is not None for r in results)
    header = ["item", "state", "motions", "tracks", "frames", "outliers", "s"]
    header += ["misclassified %"] * with_truth
    rows = []
    for result in results:
        facts = result.facts
        seconds = fixed(result.seconds, 1) if result.seconds else "-"
        if facts is None:
            cells = [*["-"] * 4, seconds, *["-"] * with_truth]
        else:
            counts = (len(facts.motions), facts.tracks, facts.frames, facts.outliers)
            cells = [*map(str, counts), seconds, *[_percent(facts.misclassification)] * with_truth]
        rows.append((result.item.name, result.state, *cells))
    return Table("Items", tuple(header), tuple(rows))


def sentence(results: Sequence[Result]) -> str:
    """How many items were done, unchanged, failed and not started."""
    count = Counter("failed" if result.has_failed else result.state for result in results)
    said = [f"{count[s]} {s}" for s in ("done", "unchanged", "failed", "not started") if count[s]]
    return f"{_count(len(results), 'item')}: {', '.join(said)}"


def index_page(results: Sequence[Result]) -> str:
    """The index as one HTML file: a card for each item, with its picture and a link to its page."""
    folder = resources.files(__package__)
    style = folder.joinpath("index.css").read_text(encoding="utf-8")
    failed = [result for result in results if result.has_failed]
    digest = base64.b64encode(hashlib.sha256(style.encode()).digest()).decode()
    state = Counter(map(_state, results))
    headline = [f"{state[s]} {s}" for s in ("done", "failed", "not started") if state[s]]
    return Template(folder.joinpath("index.html").read_text(encoding="utf-8")).substitute(
        policy=f"default-src 'none'; img-src 'self' file:; style-src 'sha256-{digest}'",
        style=style,
        headline=f"{_count(len(results), 'item')}: {', '.join(headline)}",
        failures=_failures(failed),
        cards="\n".join(_card(result) for result in results if result.facts is not None),
        version=escape(__version__),
    )


def _failures(failed: Sequence[Result]) -> str:
    if not failed:
        return ""
    rows = "".join(
        f'<tr><th scope="row">{escape(r.item.name)}</th><td>{escape(r.error)}</td></tr>'
        for r in failed
    )
    return f'<section class="failed"><h2>Failed</h2><table>{rows}</table></section>'


def _card(result: Result) -> str:
    facts = result.facts
    assert facts is not None
    name = escape(result.item.name)
    place = quote(result.item.name)
    picture = ""
    if facts.picture is not None:
        source = f"{place}/{quote(facts.picture)}"
        picture = f'<img src="{source}" loading="lazy" alt="the motions of {name}">'
    target = f"{place}/{quote(facts.page)}" if facts.page is not None else f"{place}/"
    motions = _count(len(facts.motions), "motion") if facts.motions else "no motion"
    lines = [f"{facts.tracks} tracks, {facts.frames} frames, {facts.outliers} outliers"]
    if facts.misclassification is not None:
        lines.append(f"{_percent(facts.misclassification)} % misclassified")
    return (
        f'<li><a href="{target}">{picture}<strong>{name}</strong></a> '
        f"<span>{motions}</span>{''.join(f'<small>{line}</small>' for line in lines)}</li>"
    )


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}{'s' * (number != 1)}"


def _percent(share: float | None) -> str:
    return fixed(None if share is None else 100 * share, 2)
