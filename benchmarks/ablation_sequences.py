"""What each ingredient of consensus is worth: ``python -m benchmarks.ablation_sequences FOLDER``.

FOLDER holds ``hopkins155`` and ``kt3dmoseg``. One ingredient at a time is taken away; printed are
the misclassification in per cent with the count given, unknown (at least 2), with 20 % outlier
tracks, and on KT3DMoSeg. ``--every N`` takes each N-th sequence, ``--seeds N`` averages over seeds.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from unittest.mock import patch

import numpy as np

from mssegment.benchmarking import shuffled_in_time
from mssegment.datasets import DATASETS, ImportedTracks
from mssegment.evaluation import misclassification
from mssegment.records import Floats, Integers, replace
from mssegment.sampling import frame_pairs
from mssegment.segmentation.consensus import (
    cluster_by_consensus,
    clustering,
    epipolar_evidence,
    joinedness,
    model_order,
    rigid_grouping,
    split_test,
)

Change = tuple[object, str, object]


def _all_pass(
    points: Floats, misfit: Floats, **_: object
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    return np.ones(len(points), dtype=bool)


VARIANTS: dict[str, tuple[tuple[str, ...], tuple[Change, ...]]] = {
    "everything": ((), ()),
    "no subspaces over all frames": (("factorization",), ()),
    "no uniform subsets": ((), ((frame_pairs, "LOCAL_SHARE", 1.0),)),
    "no local subsets": ((), ((frame_pairs, "LOCAL_SHARE", 0.0),)),
    "one power of the agreement (6)": (
        (),
        ((model_order, "POWERS", (6,)),),
    ),
    "not refined by Student t distributions": ((), ((model_order, "MAX_REFINED_SHARE", -1.0),)),
    "count without the border": (
        (),
        (
            (split_test, "border_contrast", lambda *_: 1.0),
            (joinedness, "border_contrast", lambda *_: 1.0),
        ),
    ),
    "no outlier tests": (
        (),
        (
            (clustering, "first_test", _all_pass),
            (frame_pairs, "first_test", _all_pass),
            (
                clustering,
                "second_test",
                lambda points, *_: np.zeros(len(points), dtype=bool),
            ),
        ),
    ),
    "outlier tests never gentle": ((), ((clustering, "limit_factor", lambda *_: 1.0),)),
    "joined without epipolar geometry": (
        (),
        ((epipolar_evidence.EpipolarEvidence, "growth", lambda *_: 0.0),),
    ),
    "one start of groups to be joined": ((), ((rigid_grouping, "PIECES", (8,)),)),
    "no fundamental matrices": (("fundamental",), ()),
}
"""Name -> kinds of evidence to leave out, and constants to change."""


@contextmanager
def changed(changes: tuple[Change, ...]) -> Iterator[None]:
    """Constants of the package changed for a while."""
    with ExitStack() as stack:
        for place, name, value in changes:
            stack.enter_context(patch.object(place, name, value))
        yield


def mean_error(
    entries: list[ImportedTracks],
    seeds: int,
    without: tuple[str, ...],
    *,
    given: bool = True,
    outliers: float = 0.0,
) -> float:
    """Mean misclassification over the sequences and seeds, NaN where no evidence is left."""
    errors = []
    for entry in entries:
        for seed in range(seeds):
            rng = np.random.default_rng(seed)
            points, labels = with_outliers(entry, outliers, rng)
            drawn = frame_pairs.draw_for_consensus(points, rng)
            sets = tuple(entry for entry in drawn.sets if entry.model not in without)
            if not any(entry.evidence for entry in sets):
                return float("nan")
            hypotheses = replace(drawn, sets=sets)
            motions = entry.motions if given else None
            found = cluster_by_consensus(points, hypotheses, rng, motions=motions, min_motions=2)
            errors.append(misclassification(found.labels, labels))
    return float(np.mean(errors))


def with_outliers(
    entry: ImportedTracks, share: float, rng: np.random.Generator
) -> tuple[Floats, Integers]:
    """The tracks in random order, with so many more that are shuffled in time (label 0)."""
    points, labels = entry.tracks.points, entry.tracks.labels
    assert labels is not None
    wrong = shuffled_in_time(points, round(share * len(points)), rng)
    points = np.concatenate([points, wrong])
    labels = np.concatenate([labels, np.zeros(len(wrong), dtype=np.int64)])
    order = rng.permutation(len(points))
    return points[order], labels[order]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--every", type=int, default=1)
    parser.add_argument("--json", action="store_true")
    arguments = parser.parse_args()
    hopkins, perspective = (
        [
            DATASETS[name].read(path)
            for path in DATASETS[name].files(arguments.folder / name)[:: arguments.every]
        ]
        for name in ("hopkins155", "kt3dmoseg")
    )
    columns: dict[str, Callable[[tuple[str, ...]], float]] = {
        "given": lambda w: mean_error(hopkins, arguments.seeds, w),
        "unknown": lambda w: mean_error(hopkins, arguments.seeds, w, given=False),
        "outliers": lambda w: mean_error(hopkins, arguments.seeds, w, outliers=0.2),
        "kt3dmoseg": lambda w: mean_error(perspective, arguments.seeds, w),
        "kt unknown": lambda w: mean_error(perspective, arguments.seeds, w, given=False),
    }
    if not arguments.json:
        print(f"{'without':34}" + "".join(f"{name:>12}" for name in columns))
    table = {}
    for variant, (without, changes) in VARIANTS.items():
        with changed(changes):
            row = {name: measure(without) for name, measure in columns.items()}
        table[variant] = row
        if not arguments.json:
            print(f"{variant:34}" + "".join(f"{100 * e:12.2f}" for e in row.values()), flush=True)
    if arguments.json:
        print(json.dumps(table, indent=1))


if __name__ == "__main__":
    main()
