"""Real data for the benchmarks, where it is there."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from scipy.io import loadmat

from mssegment.records import Floats


def data_folder() -> Path | None:
    """$MSSEGMENT_DATA, else ../shared/data beside the repository, else None."""
    named = os.environ.get("MSSEGMENT_DATA")
    folder = Path(named) if named else Path(__file__).parents[2] / "shared" / "data"
    return folder if folder.is_dir() else None


def sequence_subspaces(n: int, k: int, count: int, seed: int = 0) -> Floats | None:
    """Hypotheses of a Hopkins155 sequence [count, n, k]: spans of k neighbouring tracks.

    The tracks are reduced to their first n principal components.
    """
    folder = data_folder()
    files = sorted((folder / "hopkins155").glob("**/*_truth.mat")) if folder else []
    if not files:
        return None
    x = np.asarray(loadmat(files[0])["x"], dtype=np.float64)[:2]
    tracks = np.moveaxis(x, 1, 0).reshape(x.shape[1], -1)
    tracks /= np.abs(tracks).max()
    u, s, _ = np.linalg.svd(tracks, full_matrices=False)
    reduced = (u * s)[:, :n]
    rng = np.random.default_rng(seed)
    subsets = []
    for seed_track in rng.integers(0, len(reduced), count):
        nearest = np.argsort(np.sum((reduced - reduced[seed_track]) ** 2, axis=1))[1:13]
        subsets.append([seed_track, *rng.choice(nearest, k - 1, replace=False)])
    return np.linalg.qr(np.swapaxes(reduced[np.array(subsets)], 1, 2))[0]
