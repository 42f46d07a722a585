"""Elemental subsets: which tracks they have, what is rejected, and which errors are raised."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mssegment import manifolds, models
from mssegment.errors import DataError, MssegmentError, UsageError
from mssegment.records import Camera
from mssegment.sampling.elemental_subsets import MIN_SUPPORT
from mssegment.sampling.neighbourhoods import nearest_neighbours
from tests.stages import hypothesize

CAMERA = Camera(800.0, 800.0, 320.0, 240.0)
MODELS = models.of_pictures()
FRAMES = {name: 2 if models.MODELS[name].max_frames == 2 else 5 for name in MODELS}
TWO_VIEWS = [name for name in MODELS if models.MODELS[name].max_frames == 2]


def two_objects(rng, frames=2, outliers=20):
    """Two objects with affine motions, and mismatches: points [P, F, 2] and labels."""
    objects = []
    for place in ([150.0, 150.0], [420.0, 320.0]):
        path = [rng.uniform(-60.0, 60.0, (30, 2)) + place]
        for _ in range(frames - 1):
            turn = np.eye(2) + rng.uniform(-0.05, 0.05, (2, 2))
            path.append((path[-1] - place) @ turn + place + rng.uniform(-15.0, 15.0, 2))
        objects.append(np.stack(path, axis=1))
    points = np.concatenate([*objects, rng.uniform(50.0, 500.0, (outliers, frames, 2))])
    return points + rng.normal(0.0, 0.3, points.shape), np.repeat([1, 2, 0], [30, 30, outliers])


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("sampling", ["local", "uniform"])
def test_hypotheses_are_points_on_the_manifold_of_the_model(name, sampling, rng):
    points, _ = two_objects(rng, FRAMES[name])
    (found,) = hypothesize(
        points, model=name, camera=CAMERA, count=80, sampling=sampling, derotate=False, rng=rng
    )
    manifold = manifolds.from_name(found.manifold)
    manifold.check_point(found.points)
    assert found.points.shape == (80, *manifold.point_shape)
    model = models.make(name, frames=FRAMES[name])
    assert found.subsets.shape == (80, model.subset_size)
    assert all(len(set(row)) == model.subset_size for row in found.subsets.tolist())
    assert found.drawn >= 80


def test_local_subsets_are_mostly_of_one_motion(rng):
    points, labels = two_objects(rng)
    pure = {}
    for sampling in ("local", "uniform"):
        (found,) = hypothesize(points, count=200, sampling=sampling, rng=rng)
        of = labels[found.subsets]
        pure[sampling] = ((of == of[:, :1]).all(axis=1) & (of[:, 0] > 0)).mean()
        if sampling == "local":
            assert pure["local"] > 0.9
    assert pure["local"] >= pure["uniform"]


def test_mismatches_alone_have_no_support(rng):
    points = rng.uniform(0.0, 640.0, (60, 2, 2))
    assert hypothesize(points, count=50, rng=rng) == []
    assert MIN_SUPPORT == 3


def test_the_same_seed_gives_the_same_hypotheses():
    points, _ = two_objects(np.random.default_rng(3))
    one, two = (hypothesize(points, rng=np.random.default_rng(5))[0] for _ in range(2))
    np.testing.assert_array_equal(one.points, two.points)
    np.testing.assert_array_equal(one.subsets, two.subsets)


def test_excluded_and_incomplete_tracks_are_in_no_subset(rng):
    points, _ = two_objects(rng, 5)
    points[3, 2] = np.nan
    eligible = np.ones(len(points), dtype=bool)
    eligible[10:15] = False
    (found,) = hypothesize(points, model="factorization", eligible=eligible, count=200, rng=rng)
    assert not np.isin(found.subsets, [3, *range(10, 15)]).any()


def test_auto_samples_affine_motions_and_homographies(rng):
    points, _ = two_objects(rng)
    sets = hypothesize(points, model="auto", count=40, rng=rng)
    assert [s.model for s in sets] == ["affine", "homography"]


def test_automatic_count_is_bounded(rng):
    points, _ = two_objects(rng)
    (found,) = hypothesize(points, rng=rng)
    assert 300 <= len(found.points) <= 2000


def test_neighbours_of_a_track_are_not_itself(rng):
    points = np.repeat(rng.uniform(0.0, 10.0, (5, 2, 2)), 4, axis=0)
    near = nearest_neighbours(points, 6)
    assert near.shape == (20, 6)
    assert not (near == np.arange(20)[:, None]).any()


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"model": "afine"}, UsageError, "afine"),
        ({"count": 0}, UsageError, "count"),
        ({"sampling": "global"}, UsageError, "global"),
        ({"model": "translation", "camera": None}, DataError, "--camera"),
        ({"model": "factorization"}, DataError, "at least 3 frames"),
    ],
)
def test_invalid_arguments(change, error, message, rng):
    points, _ = two_objects(rng)
    with pytest.raises(error, match=message) as raised:
        hypothesize(points, rng=rng, **{"camera": CAMERA, **change})
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("name", TWO_VIEWS)
def test_two_view_models_reject_sequences(name, rng):
    points, _ = two_objects(rng, 4)
    with pytest.raises(DataError, match="needs 2 frames, but the tracks have 4"):
        hypothesize(points, model=name, camera=CAMERA, rng=rng)


@pytest.mark.parametrize("name", MODELS)
def test_fewer_tracks_than_a_subset(name, rng):
    points, _ = two_objects(rng, FRAMES[name])
    for count in (0, 1, 2):
        with pytest.raises(DataError, match="tracks"):
            hypothesize(points[:count], model=name, camera=CAMERA, rng=rng)


@pytest.mark.parametrize("name", MODELS)
def test_only_degenerate_subsets(name, rng):
    # all tracks in one place: collinear ones still determine a similarity
    points = np.full((30, FRAMES[name], 2), 100.0)
    with pytest.raises(DataError, match=r"degenerate|moved"):
        hypothesize(points, model=name, camera=CAMERA, rng=rng)


@settings(max_examples=40, deadline=None)
@given(
    tracks=st.integers(0, 12),
    frames=st.integers(0, 5),
    name=st.sampled_from([*MODELS, "auto"]),
    seed=st.integers(0, 1000),
    scale=st.sampled_from([0.0, 1e-9, 1.0, 1e6]),
    broken=st.booleans(),
)
def test_any_tracks_give_hypotheses_or_a_one_line_error(tracks, frames, name, seed, scale, broken):
    rng = np.random.default_rng(seed)
    points = scale * rng.normal(size=(tracks, frames, 2))
    if broken and points.size:
        points[0] = np.nan
    message, sets = "", []
    try:
        sets = hypothesize(points, model=name, camera=CAMERA, count=5, rng=rng)
    except MssegmentError as error:
        message = str(error)
    assert all(len(s.points) for s in sets)
    assert "\n" not in message
    assert all(np.isfinite(s.points).all() for s in sets)
