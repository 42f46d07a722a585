"""Manual labels for tracks: from label masks, or from located points with a label."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mssegment.datasets.base import check_labels
from mssegment.datasets.csv_tracks import LOCATED, MATCHES, read_table
from mssegment.errors import DataError
from mssegment.neighbours import nearest
from mssegment.records import IGNORED, LARGEST_COORDINATE, OUTLIER, Floats, Integers

MASK_IGNORE = 255
"""The mask value of a place that nobody may be judged by."""


def labels_from_masks(points: Floats, masks: Mapping[int, npt.NDArray[np.integer]]) -> Integers:
    """True labels [P] of the tracks [P, F, 2] from the label masks [h, w] of some frames.

    A mask says 0 for none, n for object n, 255 for "ignore". A track has label n when every
    labelled frame that sees it says n; where frames disagree, or say none, it is a true outlier
    (0). A frame that says "ignore", or in whose picture the track is not, does not vote; without
    any vote the label is IGNORED.
    """
    lowest = np.full(len(points), np.iinfo(np.int64).max)
    highest = np.full(len(points), -1)
    for frame, mask in masks.items():
        if not 0 <= frame < points.shape[1]:
            raise DataError(
                f"mask of frame {frame + 1}: the tracks have {points.shape[1]} frames; "
                "name masks like the frames they label"
            )
        if mask.ndim != 2 or not np.issubdtype(mask.dtype, np.integer):
            raise DataError(
                f"mask of frame {frame + 1}: {mask.dtype} {mask.shape}; expected one "
                "channel of whole numbers (0 none, n object, 255 ignore)"
            )
        place = np.round(np.nan_to_num(points[:, frame], nan=-1.0)).astype(int)
        height, width = mask.shape
        inside = ((place >= 0) & (place < (width, height))).all(axis=1)
        votes = np.full(len(points), MASK_IGNORE)
        votes[inside] = mask[place[inside, 1], place[inside, 0]]
        valid = votes != MASK_IGNORE
        lowest[valid] = np.minimum(lowest, votes)[valid]
        highest[valid] = np.maximum(highest, votes)[valid]
    agreed = np.where(lowest == highest, highest, OUTLIER)
    return np.where(highest < 0, IGNORED, agreed).astype(np.int64)


def labels_from_points(
    points: Floats, places: Floats, labels: Integers, radius: float = 3.0
) -> Integers:
    """True labels [P] of tracks [P, F, 2] from labelled places [n, 2] or [n, 4], pixels.

    Places [n, 2] are positions in the first frame, [n, 4] in the first and the second. A track
    takes the label of the nearest place if that is within ``radius`` in every one of these frames;
    else it is IGNORED: nobody said anything about it.
    """
    frames = places.shape[1] // 2
    if points.shape[1] < frames:
        raise DataError("labelled matches name two frames, the tracks have one; label one frame")
    found = np.full(len(points), IGNORED, dtype=np.int64)
    seen = np.isfinite(points[:, :frames]).all(axis=(1, 2))
    if not len(places) or not seen.any():
        return found
    own = points[seen, :frames].reshape(-1, 2 * frames)
    place = nearest(places, own)[1][:, 0]
    gaps = np.linalg.norm((own - places[place]).reshape(-1, frames, 2), axis=-1)
    found[seen] = np.where((gaps <= radius).all(axis=1), labels[place], IGNORED)
    return found


def read_located_labels(path: Path) -> tuple[Floats, Integers]:
    """Places [n, 2] (``x,y,label``, first frame) or [n, 4] (``x1,y1,x2,y2,label``) and labels."""
    columns = read_table(path)
    for names in (MATCHES, LOCATED[:2]):
        if set(names) <= set(columns) and "label" in columns:
            places = np.stack([columns[name] for name in names], axis=1)
            wild = np.abs(places) > LARGEST_COORDINATE
            if wild.any():
                raise DataError(
                    f"{path}: a label is at {places[wild][0]:g}; "
                    f"expected pixels, at most {LARGEST_COORDINATE:g}"
                )
            return places, check_labels(columns["label"], len(places), f"{path}: column 'label'")
    raise DataError(
        f"{path}: columns {','.join(columns)}; expected x,y,label (first frame) or "
        "x1,y1,x2,y2,label"
    )
