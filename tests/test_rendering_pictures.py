"""Annotated pictures: right place, right colour, right size; not byte for byte."""

from __future__ import annotations

from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from rendering_samples import HEIGHT, WIDTH, affine_report

from mssegment.errors import UsageError
from mssegment.records import Frame, replace
from mssegment.rendering import style
from mssegment.rendering.layout import view_of
from mssegment.rendering.pictures import KINDS, encode_pictures, frame_scene, shown_frames
from mssegment.rendering.raster import paint
from mssegment.rendering.regions import dense_labels, hulls, not_isolated
from mssegment.rendering.scene import OUTLINES, Markers, Scene
from mssegment.rendering.thinning import farthest_points, shown_displacements


def near(picture, colour, tolerance=40):
    """Where a picture (BGR) has about this colour (RGB)."""
    return (np.abs(picture[..., ::-1].astype(int) - colour) <= tolerance).all(axis=-1)


def test_names_and_sizes():
    files = dict(encode_pictures(affine_report(), "png", KINDS))
    assert list(files) == [
        "points.png",
        "frame-1.png",
        "frame-2.png",
        "side-by-side.png",
        "overlay.png",
        "regions.png",
    ]
    sizes = {
        name: cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR).shape
        for name, content in files.items()
    }
    height, width, _ = sizes["frame-1.png"]
    assert width == 2 * WIDTH
    assert height > 2 * HEIGHT
    assert sizes["side-by-side.png"][1] > 2 * width


def test_every_inlier_carries_the_colour_of_its_motion():
    report = affine_report()
    view = view_of(report, 0)
    picture = paint(frame_scene(report, view))
    for motion in report.motions:
        look = near(picture, style.label_style(motion.label).colour)
        places = view.to_picture(report.tracks.points[report.members(motion.label), 0])
        hit = [
            look[round(y) - 1 : round(y) + 2, round(x) - 1 : round(x) + 2].any() for x, y in places
        ]
        # the number of the motion may cover a few
        assert np.mean(hit) > 0.8


@pytest.mark.parametrize("shape", OUTLINES)
def test_a_marker_is_centred_and_about_as_large_as_the_others(shape):
    place = np.array([[30.25, 29.5]])
    canvas = paint(Scene(60, 60, items=[Markers(place, shape, 12.0, (0, 0, 0))]))
    ink = 1.0 - canvas[..., 0] / 255.0
    y, x = np.mgrid[:60, :60]
    middle = [(ink * x).sum() / ink.sum(), (ink * y).sum() / ink.sum()]
    assert middle == pytest.approx(
        place[0].tolist(), abs=2.5 if shape in ("triangle", "wedge") else 0.6
    )
    if shape not in ("dot", "ring"):
        assert 250 < ink.sum() < 650


def test_svg_is_well_formed_and_has_every_marker():
    report = affine_report(truth=False)
    svg = dict(encode_pictures(report, "svg", ["frames"]))["frame-1.svg"]
    root = ElementTree.fromstring(svg)
    assert root.tag.endswith("svg")
    paths = "".join(path.get("d", "") for path in root.iter("{http://www.w3.org/2000/svg}path"))
    assert paths.count("Z") >= len(report.labels)
    assert b"http" not in svg.replace(b"http://www.w3.org/2000/svg", b"")


def test_missing_pictures_give_blank_ones():
    report = affine_report(pictures=lambda index: None)
    files = dict(encode_pictures(report))
    assert len(files) == 4


def test_wrong_kinds_and_formats_are_named():
    with pytest.raises(UsageError, match="tiff"):
        list(encode_pictures(affine_report(), "tiff"))
    with pytest.raises(UsageError, match="collage"):
        list(encode_pictures(affine_report(), kinds=["collage"]))


def test_long_sequences_show_the_first_and_the_last_frame():
    assert shown_frames(3) == [0, 1, 2]
    assert shown_frames(100)[0] == 0
    assert shown_frames(100)[-1] == 99
    assert len(shown_frames(100)) == 8


def test_hulls_hold_the_object_and_forget_the_stray(rng):
    body = rng.uniform([40, 40], [120, 100], (60, 2))
    points = np.concatenate([body, [[300.0, 200.0]]])
    keep = not_isolated(points)
    assert not keep[-1]
    assert keep[:-1].mean() > 0.95
    (outline,) = hulls(points, WIDTH, HEIGHT)
    inside = [cv2.pointPolygonTest(outline.astype(np.float32), (x, y), False) >= 0 for x, y in body]
    assert np.mean(inside) > 0.9
    assert outline[:, 0].max() < 200


def test_dense_regions_follow_the_edges_of_the_picture():
    report = affine_report(tracks=120)
    picture = report.pictures(0)
    labels = dense_labels(report, 0, picture)
    truth = np.zeros((HEIGHT, WIDTH), dtype=int)
    truth[60:120, 40:120] = 1
    truth[100:200, 200:280] = 2
    for label in (1, 2):
        both = ((labels == label) & (truth == label)).sum()
        either = ((labels == label) | (truth == label)).sum()
        assert both / either > 0.85


def test_short_displacements_are_all_drawn_and_long_ones_are_thinned_evenly(rng):
    short = affine_report()
    assert shown_displacements(short, 0)[short.labels > 0].all()
    many = affine_report(tracks=900)
    many.tracks.points[:, 1] = many.tracks.points[:, 0] + [90.0, 40.0]
    kept = shown_displacements(many, 0)
    members = many.members(1)
    assert 12 <= kept[members].sum() < 0.3 * len(members)
    # no track is far from one that shows the way
    places = many.tracks.points[:, 0]
    chosen = places[members[kept[members]]]
    gaps = np.linalg.norm(places[members][:, None] - chosen[None], axis=2).min(axis=1)
    assert gaps.max() < 30


def test_farthest_points_are_as_many_as_asked_for(rng):
    points = rng.uniform(0, 100, (50, 2))
    assert len(set(farthest_points(points, 20).tolist())) == 20
    assert farthest_points(points, 80).tolist() == list(range(50))


@pytest.mark.parametrize(
    ("width", "height", "scale"), [(320, 240, 2), (1242, 375, 1), (3840, 2160, 0.5)]
)
def test_small_pictures_grow_and_huge_ones_shrink(width, height, scale):
    report = affine_report(pictures=lambda index: np.full((height, width, 3), 90, np.uint8))
    frames = tuple(Frame(frame.path, width, height) for frame in report.frames)
    view = view_of(replace(report, frames=frames), 0)
    assert view.scale == scale
    assert view.photograph.shape[:2] == (height * scale, width * scale)
    assert np.allclose(view.to_picture(np.array([-0.5, -0.5])), -0.5)
