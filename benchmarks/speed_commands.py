"""The commands against what they could cost: OpenCV's own functions, imports, one clustering.

All times are CPU seconds, of this process or of a whole child process, so that other programs on
the machine do not count; OpenCV and BLAS run on one thread.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import cv2
import numpy as np

from benchmarks.data import data_folder
from benchmarks.frontend import ours, sift
from benchmarks.timing import Row, ratio
from mssegment import pipeline
from mssegment.configuration import Configuration, Setting, resolve
from mssegment.documents import TracksDocument
from mssegment.records import Floats, Integers, Tracks

PAIR = [Path(__file__).parents[1] / "sample_data" / "affine" / f"frame-{i}.png" for i in (1, 2)]
MSSEGMENT = ("-c", "from mssegment.cli import main; main()")
NO_PICTURES = ("--set", "report.pictures=no", "--set", "report.html=no", "--quiet")
HARRIS_CORNERS, HARRIS_QUALITY, HARRIS_DISTANCE = 1500, 0.01, 3
SIFT_GOAL, PAIR_GOAL, PROCESS_GOAL, HELP_GOAL, SEQUENCE_GOAL = 2.0, 3.0, 2.0, 1.2, 2.5


def rows() -> Iterator[Row]:
    """One row per command or part of one."""
    cv2.setNumThreads(1)
    yield segmentation_of_a_pair()
    yield front_end()
    yield whole_process()
    yield help_text()
    yield sequences()


def process_seconds(arguments: Sequence[str], bytecode: str) -> float:
    """CPU seconds, user and system, of one whole process ``python *arguments``.

    What is imported is kept in the folder ``bytecode``, as it is beside an installed package.
    """
    kept = {k: v for k, v in os.environ.items() if k != "PYTHONDONTWRITEBYTECODE"}
    environment = {**kept, "PYTHONPYCACHEPREFIX": bytecode}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [sys.executable, *arguments]
    subprocess.run(command, check=True, capture_output=True, env=environment)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def process_ratio(work: Sequence[str], yardstick: Sequence[str], repeats: int) -> float:
    """Median CPU time of a process over that of another, in interleaved runs."""
    with tempfile.TemporaryDirectory() as kept:
        # the first runs bring files into memory and bytecode onto the disk
        process_seconds(work, kept), process_seconds(yardstick, kept)
        pairs = [
            (process_seconds(work, kept), process_seconds(yardstick, kept)) for _ in range(repeats)
        ]
    return statistics.median(a for a, _ in pairs) / statistics.median(b for _, b in pairs)


def segmentation_of_a_pair() -> Row:
    """Hypotheses, clustering and selection against the tracking that goes before them."""
    images = Setting("input.images", [str(path) for path in PAIR], "benchmark")
    configuration = resolve([images, Setting("hypothesize.model", "affine", "benchmark")])
    source = pipeline.open_input(configuration)
    tracks = pipeline.match(pipeline.detect(configuration, source), configuration, source)
    first, second = (cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in PAIR)

    def track() -> None:
        corners = cv2.goodFeaturesToTrack(
            first, HARRIS_CORNERS, HARRIS_QUALITY, HARRIS_DISTANCE, useHarrisDetector=True
        )
        cv2.calcOpticalFlowPyrLK(first, second, corners, None)

    return Row(
        "affine pair: hypotheses, clustering, selection / OpenCV Harris + LK",
        ratio(partial(segment, tracks, configuration), track, 7),
        PAIR_GOAL,
        note=f"{len(tracks.tracks.points)} matches",
    )


def segment(tracks: TracksDocument, configuration: Configuration) -> Integers:
    """The labels of the tracks."""
    hypotheses = pipeline.hypothesize(tracks, configuration)
    return pipeline.cluster(hypotheses, configuration).labels


def front_end() -> Row:
    """Our corners and matches of two views against SIFT with the ratio test."""
    pictures = [np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)) for path in PAIR]
    name = "affine pair: detect and match / SIFT detect, compute, ratio matching"
    return Row(name, ratio(partial(ours, pictures, "affine"), partial(sift, pictures)), SIFT_GOAL)


def whole_process(repeats: int = 5) -> Row:
    """``mssegment run`` without pictures and page against imports and reading the pictures."""
    paths = [str(path) for path in PAIR]
    reading = f"import numpy, scipy.linalg, cv2; [cv2.imread(path) for path in {paths!r}]"
    with tempfile.TemporaryDirectory() as out:
        run = [*MSSEGMENT, "run", *paths, "--out", out, "--force", *NO_PICTURES]
        found = process_ratio(run, ["-c", reading], repeats)
        told = process_ratio([*run, "--model", "affine"], ["-c", reading], repeats)
    name = "affine pair: mssegment run / importing and reading"
    return Row(name, found, PROCESS_GOAL, note=f"model auto; {told:.1f} with --model affine")


def help_text(repeats: int = 9) -> Row:
    """``mssegment --help`` against the imports of a command line."""
    found = process_ratio([*MSSEGMENT, "--help"], ["-c", "import click, rich.console"], repeats)
    return Row("mssegment --help / importing click and rich.console", found, HELP_GOAL)


def sequences() -> Row:
    """Hopkins155 against one spectral clustering of the same tracks, number of motions unknown."""
    from mssegment.datasets import DATASETS

    name = "Hopkins155: a sequence / one RSIM-like spectral clustering"
    folder = data_folder()
    if folder is None or not (folder / "hopkins155").is_dir():
        return Row(name, None, SEQUENCE_GOAL, note="$MSSEGMENT_DATA has no hopkins155")
    configured = DATASETS["hopkins155"].benchmark.settings
    configuration = resolve([Setting(k, v, "benchmark") for k, v in configured.items()])
    spent = []
    for path in DATASETS["hopkins155"].files(folder / "hopkins155"):
        entry = DATASETS["hopkins155"].read(path)
        points = entry.tracks.points
        labels = entry.tracks.labels
        groups = 2 if labels is None else len(np.unique(labels[labels > 0]))
        document = TracksDocument(frames=list(entry.frames), tracks=Tracks(points))
        start = time.process_time()
        segment(document, configuration)
        middle = time.process_time()
        shape_interaction(points, groups)
        spent.append((middle - start, time.process_time() - middle))
    mine, theirs = (float(seconds) for seconds in np.mean(spent, axis=0))
    return Row(name, mine / theirs, SEQUENCE_GOAL, note=f"{len(spent)} sequences, {mine:.2f} s")


def shape_interaction(points: Floats, groups: int) -> Integers:
    """Labels [P] in the way of Ji, Salzmann and Li (2015), the number of groups given.

    For every rank from K to 4 K: shape interaction matrix with rows of unit length, its powers as
    affinities, and the eigenvectors of the P x P Laplacian; of all ranks the one whose cut is best.
    """
    flat = points.reshape(len(points), -1)
    basis = np.linalg.svd(flat, full_matrices=False)[0]
    best, found = np.inf, np.zeros((len(flat), groups))
    for rank in range(groups, min(4 * groups, basis.shape[1]) + 1):
        rows = basis[:, :rank] / np.linalg.norm(basis[:, :rank], axis=1, keepdims=True)
        affinity = np.abs(rows @ rows.T) ** 4
        weight = 1.0 / np.sqrt(affinity.sum(axis=1))
        values, vectors = np.linalg.eigh(weight[:, None] * affinity * weight)
        cut = (groups - values[-groups:].sum()) / max(values[-groups] - values[-groups - 1], 1e-12)
        if cut < best:
            best, found = cut, vectors[:, -groups:]
    found = found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-12)
    stop = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-6)
    flags = cv2.KMEANS_PP_CENTERS
    _, labels, _ = cv2.kmeans(found.astype(np.float32), groups, None, stop, 10, flags)
    return np.asarray(labels[:, 0], dtype=np.int64)
