"""The tables that people paste, and the report that other programs read."""

from __future__ import annotations

import csv
import io
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rendering_samples import affine_report

from mssegment.records import ClusterResult, Tracks, replace
from mssegment.rendering.csv_text import neutral
from mssegment.rendering.report import build_report
from mssegment.rendering.report_json import report_json
from mssegment.rendering.style import PALETTE, label_style
from mssegment.rendering.tables import (
    FORMATS,
    Table,
    confusion_table,
    format_report,
    format_table,
    modes_table,
    number,
    result_table,
    summary,
)

TEXT = """\
motion       inliers   hypotheses      kde   rms px   true motion
1 ●               30           24   0.0600     0.25             1
2 ■               20           19   0.0310     1.25             2
outliers           9
background         1
"""

LATEX = r"""\begin{tabular}{lrrr}  % Modes
  \hline
  mode & hypotheses & kde & motion \\
  \hline
  M1 & 24 & 0.0600 & 1 \\
  M2 & 19 & 0.0310 & 2 \\
  M3 & 5 & 0.0040 & - \\
  \hline
\end{tabular}
"""


def test_result_table_is_the_one_of_the_command_line():
    assert format_table(result_table(affine_report()), "text") == TEXT


def test_modes_table_is_the_papers():
    assert format_table(modes_table(affine_report()), "latex") == LATEX


def test_confusion_table_has_outlier_row_and_column_and_both_errors():
    table = confusion_table(affine_report())
    assert table is not None
    assert table.header == ("", "found 1", "found 2", "outlier", "res", "res-hat")
    assert [row[:4] for row in table.rows] == [
        ("true 1", "30", "0", "0"),
        ("true 2", "0", "20", "0"),
        ("outlier", "0", "0", "9"),
    ]
    for row in table.rows[:2]:
        assert 0 < float(row[5]) <= float(row[4]) * (1 + 1e-3)


def test_without_truth_there_is_no_confusion_and_no_error():
    report = affine_report(truth=False)
    assert confusion_table(report) is None
    found = report_json(report)
    for key in ("misclassification", "confusion", "res", "res_hat"):
        assert found[key] is None
    assert found["motions"] == 2


def test_report_json_is_json_with_the_keys_that_others_rely_on():
    found = json.loads(json.dumps(report_json(affine_report()), allow_nan=False))
    assert found["motions"] == 2
    assert found["misclassification"] == 0
    assert found["confusion"] == [[30, 0, 0], [0, 20, 0], [0, 0, 9]]
    assert [mode["hypotheses"] for mode in found["modes"]] == [24, 19, 5]
    assert [mode["kde"] for mode in found["modes"]] == [0.06, 0.031, 0.004]
    assert len(found["res"]) == len(found["res_hat"]) == 2
    assert all(
        hat <= res * (1 + 1e-9) for res, hat in zip(found["res"], found["res_hat"], strict=True)
    )


def test_res_is_the_mean_squared_residual_over_the_true_inliers():
    """Equation (23) by hand: affine transfer errors in pixels."""
    report = affine_report()
    motion, chosen = report.motions[0], report.sets[0]
    points = report.tracks.points[report.truth == 1][:, [0, -1]]
    start, end = (points - chosen.normalization.centres).transpose(
        1, 0, 2
    ) / chosen.normalization.scale
    moved = start @ motion.parameters[:2, :2].T + motion.parameters[:2, 2]
    error = ((moved - end) ** 2).sum(axis=1) * chosen.normalization.scale**2
    assert report.res[0] == pytest.approx(error.mean(), rel=1e-6)


def test_a_report_of_nothing_has_tables_too():
    empty = ClusterResult(np.zeros(0, np.int64), (), (), (), np.zeros((0, 0)))
    report = build_report(
        frames=[], tracks=Tracks(np.zeros((0, 2, 2))), sets=[], segmentation=empty
    )
    for form in FORMATS:
        assert format_report(report, form)
    assert summary(report) == "no motion in 0 tracks"


@pytest.mark.parametrize("form", FORMATS)
def test_every_format_names_every_count(form):
    text = format_report(affine_report(), form)
    assert "24" in text
    assert "0.06" in text
    assert text.endswith("\n")


cells = st.text(alphabet=st.characters(exclude_categories=["Cs", "Cc"]), max_size=12)


@given(st.lists(st.tuples(cells, cells), max_size=4))
def test_csv_of_any_text_reads_back(rows):
    table = Table("t", ("a", "b"), tuple(rows))
    back = list(csv.reader(io.StringIO(format_table(table, "csv"))))
    assert [tuple(row) for row in back[1:]] == [tuple(map(neutral, row)) for row in rows]


@given(st.lists(st.tuples(cells, cells), min_size=1, max_size=4))
def test_latex_and_markdown_keep_their_columns(rows):
    table = Table("t", ("a", "b"), tuple(rows))
    for line in format_table(table, "latex").splitlines():
        if line.endswith(r" \\"):
            assert line.replace(r"\&", "").count("&") == 1
    for line in format_table(table, "markdown").splitlines():
        assert line.replace("\\\\", "").replace(r"\|", "").count("|") == 3


@given(st.floats(-1e300, 1e300) | st.just(float("nan")))
def test_numbers_are_short_and_true(value):
    text = number(value)
    assert len(text) <= 10
    if text != "-":
        assert float(text) == pytest.approx(value, rel=6e-3)


SIMULATIONS = {  # Machado, Oliveira, Fernandes 2009, severity 1, on linear RGB
    "protan": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deutan": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "tritan": [
        [1.255528, -0.076749, -0.178779],
        [-0.078411, 0.930809, 0.147602],
        [0.004733, 0.691367, 0.303900],
    ],
    "none": np.eye(3).tolist(),
}


def lab(linear):
    xyz = np.array(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    ) @ np.clip(linear, 0, 1)
    f = np.cbrt(xyz / [0.9505, 1.0, 1.089])
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


@pytest.mark.parametrize("kind", SIMULATIONS)
def test_neighbouring_motions_differ_for_every_kind_of_sight(kind):
    colours = np.array(PALETTE) / 255
    linear = np.where(colours <= 0.04045, colours / 12.92, ((colours + 0.055) / 1.055) ** 2.4)
    seen = [lab(np.array(SIMULATIONS[kind]) @ colour) for colour in linear]
    apart = [np.linalg.norm(a - b) for i, a in enumerate(seen) for b in seen[:i]]
    assert min(apart) > 10


def test_colour_and_shape_repeat_only_after_56_motions():
    looks = {(label_style(label).colour, label_style(label).shape) for label in range(1, 57)}
    assert len(looks) == 56


def test_notes_of_all_stages_are_said_once():
    stages = [
        {"stage": "match", "notes": ["a"]},
        {"stage": "cluster", "notes": ["the camera moves"]},
    ]
    report = affine_report(history=stages)
    assert report.notes == ("a", "the camera moves")
    assert format_report(report).count("the camera moves") == 1


def test_residual_errors_look_at_the_straightened_points():
    report = affine_report()
    bent = Tracks(report.tracks.points + 3.0)
    again = build_report(
        frames=report.frames,
        tracks=bent,
        sets=report.sets,
        segmentation=report.segmentation,
        truth=report.truth,
        straight=report.tracks.points,
    )
    assert again.res == report.res


def test_a_weak_mode_that_became_a_motion_is_in_the_table_but_not_all_before_it():
    report = affine_report()
    first, second, third = report.segmentation.modes
    weak = [replace(third, kde=0.003 / k) for k in range(1, 30)]
    modes = (first, *weak, replace(second, kde=1e-5))
    changed = replace(report.segmentation, modes=modes)
    rows = modes_table(replace(report, segmentation=changed)).rows
    assert [row[0] for row in rows] == ["M1", "M2", "M3", "M4", "M31"]
    assert rows[-1][2:] == ("1.0e-05", "2")
