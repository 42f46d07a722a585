"""Several segmentations side by side: seeds, settings, models.

The documents may have different tracks. Where they have the same ones, the share of tracks that
differ is given too, whatever the numbering of the motions.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any

import numpy as np

from mssegment.errors import UsageError
from mssegment.evaluation import match_labels
from mssegment.inputs.text import printable
from mssegment.records import OUTLIER, Integers, Motion, replace
from mssegment.rendering import style
from mssegment.rendering.layout import stack_below, stack_right, view_of
from mssegment.rendering.pictures import encode, frame_scene, motion_hulls
from mssegment.rendering.report import Report
from mssegment.rendering.scene import Label, Scene
from mssegment.rendering.tables import FORMATS, Table, fixed, format_table

MAX_COLUMNS = 3
"""Pictures in a row; four are arranged two by two."""


def comparison_table(names: Sequence[str], reports: Sequence[Report]) -> Table:
    """One row per segmentation: its motions, how well they fit, and the difference from the first.

    Parameters
    ----------
    names : sequence of str
        Names of the segmentations, for the first column.
    reports : sequence of Report
        Their reports.
    """
    with_truth = any(report.evaluation for report in reports)
    header = ["segmentation", "model", "tracks", "motions", "outliers", "rms px"]
    header += ["misclassified %"] if with_truth else []
    header += ["difference from first %"]
    rows = []
    for name, report in zip(names, reports, strict=True):
        models = dict.fromkeys(motion.model for motion in report.motions)
        evaluation = report.evaluation
        row = [
            name,
            "+".join(models) or "-",
            str(len(report.labels)),
            str(len(report.motions)),
            str(len(report.members(OUTLIER))),
            fixed(_rms(report.motions), 2),
        ]
        if with_truth:
            row.append("-" if evaluation is None else f"{100 * evaluation.misclassification:.2f}")
        row.append(fixed(_difference(report, reports[0]), 2))
        rows.append(tuple(row))
    return Table("Segmentations", tuple(header), tuple(rows))


def _rms(motions: Sequence[Motion]) -> float | None:
    """Root mean square residual of the inliers of all motions, pixels; None without any."""
    counts = np.array([len(motion.inliers) for motion in motions], dtype=np.float64)
    if not counts.sum():
        return None
    squares = np.array([motion.rms for motion in motions]) ** 2
    return float(np.sqrt((counts * squares).sum() / counts.sum()))


def _difference(report: Report, first: Report) -> float | None:
    """Percentage of tracks that differ after matching motions; None if the tracks differ."""
    if report.labels.shape != first.labels.shape:
        return None
    if not np.array_equal(report.tracks.points, first.tracks.points, equal_nan=True):
        return None
    differs = _renumber(report, first) != first.labels
    return 100 * float(np.mean(differs)) if len(differs) else 0.0


def format_comparison(names: Sequence[str], reports: Sequence[Report], form: str = "text") -> str:
    """The comparison in one of ``tables.FORMATS``; raises UsageError for another format."""
    if form not in FORMATS:
        raise UsageError(f"format {form!r}: expected {', '.join(FORMATS)}")
    if form == "json":
        return json.dumps(comparison_json(names, reports), indent=1, ensure_ascii=False) + "\n"
    return format_table(comparison_table(names, reports), form)


def comparison_json(names: Sequence[str], reports: Sequence[Report]) -> list[dict[str, Any]]:
    """The comparison as numbers, one entry per segmentation.

    ``rms`` is in pixels; ``misclassification`` and ``differs_from_first`` are 0..1, or None where
    they are not known.
    """
    entries = []
    for name, report in zip(names, reports, strict=True):
        difference = _difference(report, reports[0])
        entries.append(
            {
                "name": name,
                "models": list(dict.fromkeys(motion.model for motion in report.motions)),
                "tracks": len(report.labels),
                "motions": len(report.motions),
                "outliers": len(report.members(OUTLIER)),
                "rms": _rms(report.motions),
                "misclassification": report.evaluation and report.evaluation.misclassification,
                "differs_from_first": None if difference is None else difference / 100,
            }
        )
    return entries


def comparison_picture(
    names: Sequence[str], reports: Sequence[Report], file_format: str = "png"
) -> bytes:
    """Draw the first frame of each segmentation, with colours that match those of the first.

    Parameters
    ----------
    names : sequence of str
        Titles of the pictures.
    reports : sequence of Report
        The segmentations; those without frames are left out.
    file_format : str
        One of ``pictures.FORMATS``.

    Returns
    -------
    bytes
        The content of the file.

    Raises
    ------
    UsageError
        If no segmentation has a frame.
    """
    scenes = [
        _titled(name, _recoloured(report, reports[0]))
        for name, report in zip(names, reports, strict=True)
        if report.frames
    ]
    if not scenes:
        raise UsageError(
            "comparison picture: none of the segmentations has a frame, expected one or more"
        )
    gap = max(6, scenes[0].width // 80)
    columns = 2 if len(scenes) == 4 else MAX_COLUMNS
    rows = []
    for start in range(0, len(scenes), columns):
        row = scenes[start]
        for scene in scenes[start + 1 : start + columns]:
            row = stack_right(row, scene, gap)
        rows.append(row)
    whole = rows[0]
    for row in rows[1:]:
        whole = stack_below(whole, row, gap)
    return encode(whole, file_format, "comparison")


def _titled(name: str, report: Report) -> Scene:
    """The first frame of a report below its name."""
    view = view_of(report, 0)
    scene = frame_scene(report, view, motion_hulls(report, view))
    size = view.sizes.text
    title = Scene(scene.width, round(2.2 * size))
    shown = printable(name)
    shown = shown if len(shown) < 60 else "…" + shown[-59:]
    title.add([Label(0.8 * size, 1.5 * size, 1.1 * size, shown, style.INK, bold=True)])
    return stack_below(title, scene, 0)


def _recoloured(report: Report, first: Report) -> Report:
    """The report with motions numbered as in ``first``, if the tracks are the same.

    A motion without counterpart gets a number that ``first`` does not use.
    """
    if _difference(report, first) is None:
        return report
    numbers = _numbers_of(report, first)
    segmentation = report.segmentation
    changed = replace(
        segmentation,
        labels=_renumber(report, first),
        motions=tuple(replace(m, label=numbers[m.label]) for m in segmentation.motions),
        camera_motion=numbers.get(segmentation.camera_motion or 0),
        modes=tuple(
            replace(mode, motion=numbers.get(mode.motion, mode.motion))
            for mode in segmentation.modes
        ),
    )
    return replace(report, segmentation=changed)


def _numbers_of(report: Report, first: Report) -> dict[int, int]:
    """Label of a motion -> label of its counterpart in ``first``, or an unused one."""
    partners = match_labels(report.labels, first.labels)
    free = max([0, *first.labels.tolist()])
    numbers: dict[int, int] = {}
    for motion in report.motions:
        free += motion.label not in partners
        numbers[motion.label] = partners.get(motion.label, free)
    return numbers


def _renumber(report: Report, first: Report) -> Integers:
    """The labels [P] of the report, numbered as in ``first``."""
    labels = report.labels.copy()
    for old, new in _numbers_of(report, first).items():
        labels[report.labels == old] = new
    return labels
