"""The sections of the page below the pictures: tables and plots."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from mssegment.rendering.markup import escape
from mssegment.rendering.page.charts import manifold_svg, residual_svg
from mssegment.rendering.page.payload import (
    label_class,
    misclassified,
    residual_row,
    shown_labels,
    true_name,
)
from mssegment.rendering.page.projection import Projection, project
from mssegment.rendering.report import Report
from mssegment.rendering.tables import density, fixed, number, objects_table

MAX_MODES = 12
"""Modes that are listed, besides those of motions."""
MAX_SETS = 3
"""Hypothesis sets whose manifold is plotted."""
MAX_TOGGLES = 11
"""Labels in one column; more are in two."""
MAX_RESIDUAL_PLOTS = 12
ROWS_PER_PAGE = 25
"""Rows of the table of tracks; the script has the same number."""


def toggles_html(report: Report) -> str:
    """A check box for every label."""
    parts = []
    for label in shown_labels(report):
        marker, name = report.style(label), label_class(label)
        parts.append(
            f'<label class="toggle {name}"><input type="checkbox" data-label="{label}" checked> '
            f'<span class="key" aria-hidden="true">{marker.glyph}</span> {escape(marker.name)} '
            f'<span class="count">{len(report.members(label))}</span></label>'
        )
    return "\n".join(parts)


def motions_html(report: Report) -> str:
    """The table of motions: size, density and fit of each."""
    if not report.motions:
        return "<p>No motion was found.</p>"
    unit = f" ({report.unit})" if report.unit else ""
    header = [report.noun, "model", "inliers", "hypotheses", "kernel density"]
    header += [f"RMS residual{unit}", f"largest residual{unit}"]
    saves = any(motion.cost_saved is not None for motion in report.motions)
    header += ["description length saved (nats)"] if saves else []
    tested = any(motion.log_nfa is not None for motion in report.motions)
    header += ["log false alarms (nats)"] if tested else []
    told_apart = any(motion.separation is not None for motion in report.motions)
    header += ["separation from the nearest (> 1: two)"] if told_apart else []
    header += ["true motion"] if report.evaluation else []
    rows = []
    for motion in report.motions:
        modes = report.modes_of(motion.label)
        row = residual_row(report, motion.label)
        own = np.zeros(0) if row is None else report.segmentation.residuals[row]
        own = own[report.members(motion.label)] if len(own) else own
        own = own[np.isfinite(own)]
        cells = [
            escape(motion.model),
            str(len(report.members(motion.label))),
            str(sum(mode.hypotheses for mode in modes)),
            density(modes[0].kde if modes else None),
            _length(report, motion.rms),
            _length(report, float(own.max()) if len(own) else None),
        ]
        cells += [fixed(motion.cost_saved, 1)] if saves else []
        cells += [fixed(motion.log_nfa, 1)] if tested else []
        cells += [fixed(motion.separation, 1)] if told_apart else []
        if report.evaluation:
            true = report.true_motion(motion.label)
            cells.append("none" if true is None else str(true))
        rows.append(_row(_motion_key(report, motion.label), cells))
    return _table("Motions", header, rows) + _joined_html(report)


def _length(report: Report, value: float | None) -> str:
    """A residual: pixels with two decimals, other units with three digits."""
    if value is None or report.of_pictures:
        return fixed(value, 2)
    return number(value, 3)


def _joined_html(report: Report) -> str:
    """The motions that were joined to rigid bodies, and the evidence for each body."""
    rows = []
    for motion in report.motions:
        for k, part in enumerate(motion.parts, start=1):
            evidence = fixed(motion.rigid_evidence, 1) if k == 1 else ""
            cells = [f"{k}", escape(part.model), str(len(part.inliers)), fixed(part.rms, 2)]
            rows.append(_row(_motion_key(report, motion.label), [*cells, evidence]))
    if not rows:
        return ""
    text = (
        "One epipolar geometry explains the parts of each of these motions better than several: "
        "they are one rigid body, such as the static scene before a moving camera. The evidence is "
        "the logarithm of how many times better."
    )
    header = ["motion", "part", "model", "inliers", "RMS residual (px)", "evidence (nats)"]
    return f"<p>{text}</p>" + _table("Joined motions", header, rows)


def modes_html(report: Report) -> str:
    """The table of modes by kernel density, and how the motions were selected among them."""
    modes = report.segmentation.modes
    if not modes:
        return "<p>No mode was found.</p>"
    highest = max([mode.kde for mode in modes if np.isfinite(mode.kde)], default=1.0) or 1.0
    rows = []
    shown = [i for i, mode in enumerate(modes) if i < MAX_MODES or mode.motion > 0]
    for i in shown:
        mode = modes[i]
        share = 100 * mode.kde / highest if np.isfinite(mode.kde) else 0.0
        bar = (
            f'<svg class="bar {label_class(mode.motion)}" viewBox="0 0 100 10" '
            f'preserveAspectRatio="none" aria-hidden="true"><rect width="{share:.1f}" height="10"/>'
            f"</svg>"
        )
        cells = [str(mode.hypotheses), density(mode.kde), bar]
        cells.append(_label_cell(report, mode.motion))
        cells += [str(mode.set_index + 1)] if len(report.sets) > 1 else []
        rows.append(_row(f"M{i + 1}", cells))
    header = ["mode", "hypotheses", "kernel density", "", "motion"]
    header += ["set"] if len(report.sets) > 1 else []
    more = len(modes) - len(shown)
    note = f"<p class='hint'>{_count(more, 'weaker mode')} not shown.</p>" if more > 0 else ""
    return f"<p>{escape(_selection_text(report))}</p>" + _table("Modes", header, rows) + note


def _selection_text(report: Report) -> str:
    """What separates the modes that became motions from the others."""
    modes = report.segmentation.modes
    kept = [(mode.kde, f"M{i + 1}") for i, mode in enumerate(modes) if mode.motion > 0]
    rest = [(mode.kde, f"M{i + 1}") for i, mode in enumerate(modes) if mode.motion <= 0]
    if not kept:
        return "No mode became a motion."
    weakest = min(kept)
    text = f"{len(kept)} of {_count(len(modes), 'mode')} became motions."
    if rest:
        strongest = max(rest)
        ratio = weakest[0] / strongest[0] if strongest[0] > 0 else float("inf")
        text += (
            f" The weakest of them, {weakest[1]}, has {number(ratio, 3)} times the kernel density "
            f"of {strongest[1]}, the strongest other mode."
        )
    saved = [m.cost_saved for m in report.motions if m.cost_saved is not None]
    if saved:
        text += (
            " Motions were selected by description length: each shortens the description of the "
            f"tracks by at least {fixed(min(saved), 1)} nats, net of its own cost."
        )
    return text


def manifolds_html(report: Report) -> str:
    """Plots of at most ``MAX_SETS`` hypothesis sets, that of the strongest mode first."""
    order = list(dict.fromkeys(mode.set_index for mode in report.segmentation.modes))
    views = [(i, project(report, i)) for i in order[:MAX_SETS] if i < len(report.sets)]
    figures = [
        f"<figure>{manifold_svg(report, view)}"
        f"<figcaption>{escape(_manifold_caption(report, i, view))}</figcaption></figure>"
        for i, view in views
        if view is not None
    ]
    more = len(order) - MAX_SETS
    note = f"<p class='hint'>{_count(more, 'more set')} of hypotheses not shown.</p>"
    if not figures:
        return "<p>There are no hypotheses to plot.</p>"
    return "".join(figures) + (note if more > 0 else "")


def _manifold_caption(report: Report, index: int, view: Projection) -> str:
    """What the plot of a manifold shows."""
    count, plotted = len(report.sets[index].points), len(view.points)
    hypotheses = _count(count, "hypothesis", "hypotheses")
    text = f"{report.sets[index].model}, {view.manifold}: "
    text += hypotheses if plotted == count else f"{plotted} of {hypotheses}"
    if view.hemisphere:
        text += (
            " (directions of translation) on the hemisphere, in Lambert's equal-area projection. "
        )
    else:
        text += (
            f" in the tangent space at M{view.mode_indices[0] + 1}, along the two directions of "
        )
        text += f"largest spread ({100 * (view.shown or 0):.0f} % of it)"
        text += f"; {view.hidden} outside the plot. " if view.hidden else ". "
    if view.paths:
        text += (
            f"Lines: {_count(len(view.paths), 'mean shift trajectory', 'mean shift trajectories')}."
        )
    return text


def residuals_html(report: Report) -> str:
    """Plots of the distributions of the residuals to the motions."""
    figures = [residual_svg(report, motion.label) for motion in report.motions[:MAX_RESIDUAL_PLOTS]]
    if not any(figures):
        return "<p>There are no residuals to plot.</p>"
    return f'<div class="small-multiples">{"".join(figures)}</div>'


def confusion_html(report: Report) -> str:
    """The confusion matrix, with the residual errors (23) and (24) of the paper."""
    evaluation = report.evaluation
    if evaluation is None or report.res is None or report.res_hat is None:
        return (
            "<p>There are no true labels; <code>mssegment report --labels</code> compares with "
            "manual ones.</p>"
        )
    order = {motion.label: i for i, motion in enumerate(report.motions)}
    back = {true: found for found, true in evaluation.matching.items()}
    rows = []
    for i, counts in enumerate(evaluation.confusion):
        last = i == len(evaluation.true_motions)
        true = None if last else evaluation.true_motions[i]
        total = max(1, int(counts.sum()))
        cells = []
        for j, count in enumerate(counts):
            right = last and (
                j == len(counts) - 1 or evaluation.found_motions[j] == evaluation.world
            )
            if true is not None and j < len(evaluation.found_motions):
                right = evaluation.matching.get(evaluation.found_motions[j]) == true
            level = -(-4 * int(count) // total)
            kind = "right" if right else "wrong"
            cells.append(f'<td class="{kind} level{level}">{count}</td>')
        found = order.get(back.get(true, 0)) if true is not None else None
        errors = ("", "") if found is None else (report.res[found], report.res_hat[found])
        cells += [f"<td>{e if isinstance(e, str) else number(e, 4)}</td>" for e in errors]
        zero = "outlier" if evaluation.world is None else "background 0"
        name = zero if true is None else f"true {true}"
        rows.append(f'<tr><th scope="row">{name}</th>{"".join(cells)}</tr>')
    header = ["", *(f"found {f}" for f in evaluation.found_motions)]
    header += ["outlier", "res (23)", "res-hat (24)"]
    share = 100 * evaluation.misclassification
    text = f"{share:.2f} % of {evaluation.counted} evaluated tracks are misclassified."
    text += f" The adjusted Rand index is {evaluation.adjusted_rand:.3f}."
    return f"<p>{text}</p>" + _table("Confusion matrix", header, rows) + _objects_html(report)


def _objects_html(report: Report) -> str:
    """How well each true object is found; nothing without one."""
    table = objects_table(report)
    if table is None:
        return ""
    rows = [_row(escape(row[0]), [escape(cell) for cell in row[1:]]) for row in table.rows]
    return _table(table.title, list(table.header), rows)


def tracks_html(report: Report) -> str:
    """The first page of the table of tracks; the script shows the others."""
    wrong = misclassified(report)
    truth = report.truth
    unit = f" ({report.unit})" if report.unit else ""
    header = ["track", "found", "true", f"residual{unit}", f"next best residual{unit}"]
    header += ["displacement (px)"]
    rows = []
    for i in range(min(ROWS_PER_PAGE, len(report.labels))):
        own, other = _best_residuals(report, i)
        track = report.tracks.points[i]
        track = track[np.isfinite(track).all(axis=1)]
        moved = float(np.hypot(*(track[-1] - track[0]))) if len(track) > 1 else None
        cells = [
            _label_cell(report, int(report.labels[i])),
            ""
            if truth is None
            else true_name(report, int(truth[i])) + (" (error)" if wrong[i] else ""),
            _length(report, own),
            _length(report, other),
            fixed(moved, 1),
        ]
        rows.append(_row(str(i + 1), cells))
    return _table("Tracks", header, rows, identifier="track-table")


def _best_residuals(report: Report, track: int) -> tuple[float | None, float | None]:
    """Residual to the motion of a track (or the best one), and the least of the others."""
    residuals = report.segmentation.residuals
    if residuals.ndim != 2 or not len(residuals):
        return None, None
    column = residuals[:, track]
    label = int(report.labels[track])
    row = residual_row(report, label) if label > 0 else None
    finite = np.where(np.isfinite(column), column, np.inf)
    first = int(np.argmin(finite)) if row is None else row
    rest = np.delete(finite, first)
    own, other = float(finite[first]), float(rest.min()) if len(rest) else np.inf
    return (own if own < np.inf else None), (other if other < np.inf else None)


def provenance_html(report: Report) -> str:
    """How the result was made: frames, stages with their settings, configuration."""
    parts = [_table("Frames", ["frames", "file", "size", "SHA-256"], _files(report))]
    stages = [
        _row(
            escape(str(entry.get("stage", f"step {i + 1}"))),
            [escape(str(entry.get("version", ""))), _settings(entry)],
        )
        for i, entry in enumerate(report.history)
    ]
    if stages:
        parts.append(_table("Stages", ["stage", "version", "settings"], stages))
    if report.configuration:
        text = json.dumps(report.configuration, indent=2, default=str, ensure_ascii=False)
        parts.append(
            f"<details><summary>Configuration</summary><pre>{escape(text)}</pre></details>"
        )
    return "".join(parts)


def _files(report: Report) -> list[str]:
    """A row for each file, with its frames: a video is one file."""
    rows: list[str] = []
    frames = report.frames
    start = 0
    for end in range(1, len(frames) + 1):
        first = frames[start]
        if end < len(frames) and (frames[end].path, frames[end].sha256) == (
            first.path,
            first.sha256,
        ):
            continue
        name = str(end) if end == start + 1 else f"{start + 1}–{end}"
        size = f"{first.width} × {first.height}"
        rows.append(_row(name, [escape(first.path), size, _hash(first.sha256)]))
        start = end
    return rows


def _settings(entry: Mapping[str, Any]) -> str:
    """The settings of a stage, and whatever else its entry has."""
    settings = entry.get("settings", {})
    items = settings.items() if isinstance(settings, Mapping) else [("settings", settings)]
    known = {"stage", "version", "settings", "notes"}
    items = [*items, *((k, v) for k, v in entry.items() if k not in known and v)]
    return "<br>".join(
        f"<code>{escape(str(key))}</code> {escape(json.dumps(value, default=str))}"
        for key, value in items
    )


def _hash(text: str) -> str:
    """The beginning of a digest, with all of it as a tooltip."""
    return f'<code title="{escape(text)}">{escape(text[:12])}</code>' if text else "-"


def _label_cell(report: Report, label: int) -> str:
    """A label in a table: marker and number or name, a dash for outliers."""
    if label == 0:
        return "-"
    return _key(report, label) + (str(label) if label > 0 else escape(report.style(label).name))


def _motion_key(report: Report, label: int) -> str:
    """Marker and number of a motion, and whether it is the camera's."""
    name = " camera" if label == report.camera_motion else ""
    return f"{_key(report, label)}{label}{name}"


def _key(report: Report, label: int) -> str:
    """The marker of a label, with a space after it."""
    glyph = report.style(label).glyph
    return f'<span class="key {label_class(label)}" aria-hidden="true">{glyph}</span> '


def _count(number: int, noun: str, plural: str = "") -> str:
    """A number with its noun in singular or plural."""
    return f"{number} {noun if number == 1 else plural or noun + 's'}"


def _row(head: str, cells: list[str]) -> str:
    """A row of a table; head and cells are HTML."""
    body = "".join(f"<td>{cell}</td>" for cell in cells)
    return f'<tr><th scope="row">{head}</th>{body}</tr>'


def _table(caption: str, header: list[str], rows: list[str], identifier: str = "") -> str:
    """A table that scrolls sideways where it is too wide."""
    heads = "".join(
        f'<th scope="col">{escape(text)}</th>' if text else "<td></td>" for text in header
    )
    name = f' id="{identifier}"' if identifier else ""
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(caption)}">'
        f"<table{name}><caption>{escape(caption)}</caption>"
        f"<thead><tr>{heads}</tr></thead><tbody>{''.join(rows)}</tbody></table></div>"
    )
