"""The benchmark harness: figures that add up, labels that stay hidden, outliers as announced."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.io

from mssegment import benchmarking, pipeline
from mssegment.benchmarking import Case, Options, SequenceResult, run_benchmark, summarise
from mssegment.configuration import Configuration
from mssegment.documents import HypothesesDocument, TracksDocument
from mssegment.errors import DataError, UsageError


@pytest.fixture
def folder(tmp_path: Path, rng: np.random.Generator) -> Path:
    """A data set in the format of Hopkins155: two sequences of two translating, growing bodies."""
    for name, frames in (("cars1", 12), ("cars2_g12", 10)):
        y = np.ones((3, 60, frames))
        labels = np.repeat([1, 2], 30)
        for label, speed in ((1, (3.0, 1.0)), (2, (-2.0, 4.0))):
            start = rng.uniform(0, 100, (30, 2)) + (300 if label == 2 else 100)
            middle = start.mean(axis=0)
            for frame in range(frames):
                turned = (start - middle) * (1 + 0.02 * label * frame)
                y[:2, labels == label, frame] = (middle + turned + np.multiply(speed, frame)).T
        (tmp_path / name).mkdir()
        y[:2] += rng.normal(0, 0.1, y[:2].shape)
        variables = {"y": y, "s": labels[:, None], "width": 640, "height": 480}
        scipy.io.savemat(tmp_path / name / f"{name}_truth.mat", variables)
    return tmp_path


def test_results_add_up_and_do_not_depend_on_jobs(folder: Path) -> None:
    alone = list(run_benchmark("hopkins155", folder, seeds=2, min_motions=2))
    together = list(run_benchmark("hopkins155", folder, seeds=2, min_motions=2, jobs=2))
    assert [(r.name, r.seed, r.error, r.motions_found) for r in alone] == [
        (r.name, r.seed, r.error, r.motions_found) for r in together
    ]
    assert len(alone) == benchmarking.number_of_results("hopkins155", folder, seeds=2)
    assert [r.error for r in alone] == [0.0] * 4
    groups = summarise(alone)
    assert list(groups) == ["traffic-2", "all"]
    assert groups["all"].sequences == 2
    assert groups["all"].count_right == 1.0


def test_summary_is_mean_over_results_and_median_over_sequences() -> None:
    errors = {"a": (0.0, 0.0), "b": (0.1, 0.3), "c": (0.0, 0.6)}
    results = [
        SequenceResult(name, "x", error, 2, 2 + (error > 0.5), 1.0, seed)
        for name, pair in errors.items()
        for seed, error in enumerate(pair)
    ]
    summary = summarise(results)["all"]
    assert summary.mean == pytest.approx(1.0 / 6)
    assert summary.median == pytest.approx(0.2)
    assert summary.count_right == pytest.approx(5 / 6)
    assert summarise([]) == {}


def test_the_pipeline_never_sees_the_labels(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    inner = pipeline.hypothesize

    def watched(document: TracksDocument, configuration: Configuration) -> HypothesesDocument:
        assert document.tracks.labels is None
        return inner(document, configuration)

    monkeypatch.setattr(pipeline, "hypothesize", watched)
    assert len(list(run_benchmark("hopkins155", folder, seeds=1))) == 2


def test_outliers_are_half_foreign_and_half_shuffled(
    folder: Path, rng: np.random.Generator
) -> None:
    files = tuple(sorted(folder.glob("*/*.mat")))
    options = Options("hopkins155", "auto", (), 0.2, 0, False, files)
    entry = benchmarking.cases.read_entry("hopkins155", files[0])
    points, labels = benchmarking.add_outliers(
        entry.tracks.points, entry.tracks.labels, options, Case(files[0]), rng
    )
    assert points.shape[0] == 72
    assert (labels[60:] == 0).all()
    sums = np.sort(entry.tracks.points.sum(axis=(1, 2)))
    shuffled = [np.abs(sums - track.sum()).min() < 1e-6 for track in points[60:]]
    assert sum(shuffled) == 6


def test_outliers_of_pairs_are_uniform_mismatches(rng: np.random.Generator) -> None:
    points = rng.uniform(10, 20, (50, 2, 2))
    added = benchmarking.uniform_mismatches(points, 200, rng)
    assert added.shape == (200, 2, 2)
    assert (added >= points.min(axis=0)).all()
    assert (added <= points.max(axis=0)).all()


def test_resampled_tracks_keep_their_ends(rng: np.random.Generator) -> None:
    tracks = rng.normal(size=(3, 7, 2))
    other = benchmarking.resampled(tracks, 11)
    np.testing.assert_allclose(other[:, [0, -1]], tracks[:, [0, -1]])
    np.testing.assert_allclose(benchmarking.resampled(tracks, 7), tracks)


def test_single_groups_are_sequences_of_their_own(folder: Path) -> None:
    results = list(run_benchmark("hopkins155", folder, seeds=1, single_groups=True))
    assert [r.name for r in results] == ["cars1#1", "cars1#2", "cars2_g12#1", "cars2_g12#2"]
    assert {r.motions_true for r in results} == {1}


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ({"dataset": "hopkins"}, UsageError),
        ({"seeds": 0}, UsageError),
        ({"outliers": -1.0}, UsageError),
        ({"dataset": "adelaidermf", "folder": "nowhere"}, DataError),
    ],
)
def test_senseless_calls(folder: Path, arguments: dict, error: type) -> None:
    given = {"dataset": "hopkins155", "folder": folder} | arguments
    with pytest.raises(error):
        list(run_benchmark(given.pop("dataset"), given.pop("folder"), **given))
