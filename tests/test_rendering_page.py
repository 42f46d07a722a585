"""The page as text: complete, closed to the network, safe against hostile names, small."""

from __future__ import annotations

import base64
import hashlib
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rendering_samples import affine_report

from mssegment.inputs.text import printable
from mssegment.manifolds import from_name
from mssegment.records import (
    ClusterResult,
    Frame,
    HypothesisSet,
    Mode,
    Normalization,
    Tracks,
    replace,
)
from mssegment.rendering.page import payload, render_page
from mssegment.rendering.page.projection import project
from mssegment.rendering.pictures import KINDS, render_pictures
from mssegment.rendering.report import build_report

VOID = {"meta", "input", "img", "br", "link"}


class Reader(HTMLParser):
    """Collects tags and what stands in scripts; complains about tags that do not close."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.open: list[str] = []
        self.scripts: list[str] = []
        self.styles: list[str] = []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "script":
            self.scripts.append(data)
        if self.open and self.open[-1] == "style":
            self.styles.append(data)


def test_every_tag_closes_and_every_section_has_a_table_or_a_drawing():
    page = Reader(render_page(affine_report()))
    assert page.open == []
    names = [tag for tag, _ in page.tags]
    assert names.count("table") >= 5
    assert names.count("h1") == 1
    identifiers = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(identifiers) == len(set(identifiers))


def test_nothing_is_fetched_and_no_attribute_runs_a_script():
    text = render_page(affine_report())
    for _, attributes in Reader(text).tags:
        assert not any(name.startswith("on") or name == "style" for name in attributes)
        for name in ("src", "href"):
            value = attributes.get(name) or "#"
            assert value.startswith(("data:image/jpeg;base64,", "#"))


def test_the_policy_allows_exactly_our_script_and_style():
    text = render_page(affine_report())
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', text).group(1)
    page = Reader(text)

    def digest(content):
        return "'sha256-" + base64.b64encode(hashlib.sha256(content.encode()).digest()).decode()

    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert digest(page.scripts[1]) in policy
    assert digest(page.styles[0]) in policy


hostile = st.text(st.characters(exclude_categories=["Cs"]), max_size=30).map(
    lambda text: f"<script>x()</script>'\"&</style>$data{text}"
)


@settings(max_examples=10, deadline=None)
@given(hostile)
def test_hostile_text_is_escaped_everywhere(text):
    report = affine_report(
        tracks=12,
        history=[{"stage": text, "version": text, "settings": {text: text}}],
        configuration={text: text},
        pictures=lambda index: None,
    )
    named = replace(report, frames=tuple(Frame(text, 320, 240) for _ in report.frames))
    plain = Reader(render_page(affine_report(tracks=12)))
    page = Reader(render_page(named))
    count = [tag for tag, _ in page.tags].count("script")
    assert count == [tag for tag, _ in plain.tags].count("script") == 2
    assert page.open == []
    assert json.loads(page.scripts[0])["frames"][0]["name"] == printable(text)


def test_the_numbers_for_the_script_are_the_reports():
    report = affine_report(frames=3)
    report.tracks.points[4, 1] = np.nan
    data = payload.numbers(report)
    coded = np.frombuffer(base64.b64decode(data["points"]), "<i2").reshape(-1, 3, 2)
    assert (coded[4, 1] == payload.NOT_VISIBLE).all()
    seen = report.tracks.visible
    error = coded[seen] / data["stepsPerPixel"] - report.tracks.points[seen]
    assert np.abs(error).max() <= 0.5 / data["stepsPerPixel"] + 1e-9
    assert np.array_equal(np.frombuffer(base64.b64decode(data["labels"]), "<i2"), report.labels)
    limit = report.segmentation.residuals[0][report.members(1)].max()
    assert data["styles"][0]["limit"] == pytest.approx(limit)


def test_photographs_stay_within_their_share(rng):
    noise = [rng.integers(0, 256, (700, 900, 3), dtype=np.uint8) for _ in range(12)]
    report = affine_report(frames=12, pictures=lambda index: noise[index])
    addresses = payload.photographs(report)
    assert sum(map(len, addresses)) <= payload.PHOTOGRAPH_BYTES * 4 / 3 + 12 * 64


def test_missing_pictures_are_said():
    text = render_page(affine_report(pictures=lambda index: None))
    assert "2 of 2 pictures are not available" in text
    assert "not available" not in render_page(affine_report())


def test_an_empty_report_has_a_page():
    empty = ClusterResult(np.zeros(0, np.int64), (), (), (), np.zeros((0, 0)))
    report = build_report(
        frames=[], tracks=Tracks(np.zeros((0, 2, 2))), sets=[], segmentation=empty
    )
    assert "no motion in 0 tracks" in render_page(report)


def sphere_report(points, labels):
    """A report of nothing but hypotheses on G(3,1) with two modes."""
    centres = np.array([[[0.0], [0.0], [1.0]], [[1.0], [0.0], [0.0]]])
    modes = tuple(Mode(0, 5, 0.2 - 0.1 * k, centres[k], k + 1) for k in range(2))
    chosen = HypothesisSet(
        "translation",
        "grassmann(3,1)",
        (0, 1),
        Normalization(np.zeros((2, 2)), 1.0),
        np.zeros((len(points), 2), dtype=np.int64),
        points,
    )
    found = ClusterResult(
        np.zeros(0, np.int64), modes, (), (0.1,), np.zeros((0, 0)), (np.asarray(labels),)
    )
    frames = [Frame("1.png", 10, 10), Frame("2.png", 10, 10)]
    tracks = Tracks(np.zeros((0, 2, 2)))
    return build_report(frames=frames, tracks=tracks, sets=[chosen], segmentation=found)


def test_the_hemisphere_keeps_areas_and_forgets_signs(rng):
    points = from_name("grassmann(3,1)").random_point(rng, 600)
    view = project(sphere_report(points, np.zeros(600, np.int64)), 0)
    again = project(sphere_report(-points, np.zeros(600, np.int64)), 0)
    assert view.hemisphere
    assert np.allclose(view.points, again.points)
    radius = np.hypot(*view.points.T)
    assert radius.max() <= 1 + 1e-12
    # equal areas: half of uniform directions lie within the disc of half the area
    assert abs((radius < np.sqrt(0.5)).mean() - 0.5) < 0.08


def test_paths_of_mean_shift_end_near_each_other(rng):
    base = np.array([0.0, 0.0, 1.0])
    points = base + 0.08 * rng.standard_normal((60, 3))
    points = (points / np.linalg.norm(points, axis=1, keepdims=True))[..., None]
    view = project(sphere_report(points, np.zeros(60, np.int64)), 0)
    ends = np.array([path[-1] for path in view.paths])
    starts = np.array([path[0] for path in view.paths])
    assert ends.std(axis=0).max() < 0.2 * starts.std(axis=0).max()


def test_the_tangent_view_keeps_distances_from_the_strongest_mode():
    report = affine_report()
    view = project(report, 0)
    assert not view.hemisphere
    assert 0 < view.shown <= 1
    manifold = from_name(report.sets[0].manifold)
    base = report.segmentation.modes[0].point
    true = manifold.norm(base, manifold.log(base, report.sets[0].points[view.chosen]))
    drawn = np.hypot(*(view.points - view.origin).T) * view.radius
    fine = np.isfinite(drawn)
    assert fine.sum() > 20
    assert (drawn[fine] <= true[fine] * (1 + 1e-6)).all()
    assert np.allclose(view.modes[0], view.origin)


wild = st.one_of(
    st.floats(-1e12, 1e12),
    st.floats(-1.0, 400.0),
    st.just(float("nan")),
    st.sampled_from([0.0, -0.5, 319.5, 1e30, -1e30]),
)


@settings(max_examples=8, deadline=None)
@given(st.lists(st.tuples(wild, wild, wild, wild), min_size=1, max_size=12), st.integers(0, 2))
def test_wild_tracks_are_drawn_somehow(rows, label):
    points = np.array(rows).reshape(-1, 2, 2)
    points[~np.isfinite(points).all(axis=2)] = np.nan
    plain = affine_report(truth=False)
    labels = np.full(len(points), label)
    residuals = np.abs(np.nan_to_num(points[:, 0].T, nan=1.0))
    changed = replace(plain.segmentation, labels=labels, residuals=residuals)
    report = replace(plain, tracks=Tracks(points), segmentation=changed)
    assert Reader(render_page(report)).open == []
    assert len(render_pictures(report, "jpg", KINDS)) == 6
    assert render_pictures(report, "svg", ["overlay"])


def test_a_set_that_does_not_fit_its_manifold_is_not_drawn():
    report = affine_report()
    bent = replace(report.sets[0], manifold="grassmann(10,3)")
    assert "There are no hypotheses to plot" in render_page(replace(report, sets=(bent,)))
