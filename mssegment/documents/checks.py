"""Validation of a document beyond its types: shapes, indices and ranges.

Each check raises ValueError with the name of the field, what was found and what was expected;
``documents.decode`` adds the name of the file.
"""

from __future__ import annotations

import numpy as np

from mssegment.records import (
    LARGEST_COORDINATE,
    Camera,
    Floats,
    Frame,
    HypothesisSet,
    Integers,
    Mode,
    Motion,
    Normalization,
    Tracks,
)


def check_shape(array: Floats | Integers, expected: tuple[int | None, ...], name: str) -> None:
    """Raises ValueError unless the array has the expected shape; None matches any length."""
    fits = array.ndim == len(expected) and all(
        want in (None, have) for want, have in zip(expected, array.shape, strict=True)
    )
    if not fits:
        shape = " x ".join("n" if n is None else str(n) for n in expected)
        found = " x ".join(str(n) for n in array.shape)
        raise ValueError(f"{name} has shape {found}; expected {shape}")


def check_indices(indices: Integers, count: int, name: str, things: str) -> None:
    """Raises ValueError for an index outside 0 .. ``count`` - 1."""
    if indices.size and (indices.min() < 0 or indices.max() >= count):
        raise ValueError(
            f"{name} holds indices from {indices.min()} to {indices.max()}; expected at least 0 "
            f"and less than {count}, the number of {things}"
        )


def check_tracks(tracks: Tracks, frames: int) -> None:
    """Raises ValueError if the arrays of the tracks do not match the frames or each other."""
    check_shape(tracks.points, (None, frames, 2), "tracks.points")
    count = len(tracks.points)
    half_seen = np.isfinite(tracks.points).any(axis=-1) != np.isfinite(tracks.points).all(axis=-1)
    if half_seen.any():
        track, frame = np.argwhere(half_seen)[0]
        raise ValueError(
            f"tracks.points[{track}][{frame}] holds one number and one null; expected [x, y], or "
            "[null, null] where the point is not visible in that frame"
        )
    check_reach(tracks.points, "tracks.points")
    if tracks.affines is not None:
        check_shape(tracks.affines, (count, 2, 2), "tracks.affines")
        check_reach(tracks.affines, "tracks.affines")
    if tracks.labels is not None:
        check_shape(tracks.labels, (count,), "tracks.labels")
    if tracks.ids is not None and len(tracks.ids) != count:
        raise ValueError(
            f"tracks.ids has {len(tracks.ids)} entries; expected {count}, one per track"
        )


def check_status(status: Integers, tracks: Tracks) -> None:
    """Raises ValueError unless there is one valid status per track."""
    check_shape(status, (len(tracks.points),), "status")
    wrong = status[(status > 0) | (status < -2)]
    if wrong.size:
        raise ValueError(
            f"status holds {wrong[0]}; expected 0 (to be segmented), -1 (background) or "
            "-2 (not judged)"
        )


def check_sets(sets: list[HypothesisSet], tracks: Tracks, frames: int) -> None:
    """Raises ValueError if the arrays of a set do not match each other, the tracks or frames."""
    for i, chosen in enumerate(sets):
        name = f"sets[{i}]"
        if len(chosen.subsets) or len(chosen.points):
            check_shape(chosen.subsets, (len(chosen.points), None), f"{name}.subsets")
        check_indices(chosen.subsets, len(tracks.points), f"{name}.subsets", "tracks")
        check_indices(np.array(chosen.frames, dtype=np.int64), frames, f"{name}.frames", "frames")
        if not np.isfinite(chosen.points).all():
            raise ValueError(f"{name}.points holds null; expected a number for every parameter")
        check_reach(chosen.points, f"{name}.points")
        _check_normalization(chosen.normalization, len(chosen.frames), f"{name}.normalization")


def _check_normalization(normalization: Normalization, frames: int, name: str) -> None:
    check_shape(normalization.centres, (frames, 2), f"{name}.centres")
    if not np.isfinite(normalization.centres).all():
        raise ValueError(f"{name}.centres holds null; expected pixels")
    check_reach(normalization.centres, f"{name}.centres")
    for field, value in (("scale", normalization.scale), ("aspect", normalization.aspect)):
        if not 0 < value <= LARGEST_COORDINATE:
            raise ValueError(
                f"{name}.{field} is {value:g}; expected more than 0 and at most "
                f"{LARGEST_COORDINATE:g}"
            )
    if normalization.rotation is not None:
        check_shape(normalization.rotation, (3, 3), f"{name}.rotation")
        turn = normalization.rotation
        if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6):
            raise ValueError(f"{name}.rotation is not orthogonal; expected a rotation matrix")


def check_frames(frames: list[Frame]) -> None:
    """Raises ValueError for a frame without a valid size."""
    for i, frame in enumerate(frames):
        if not (0 < frame.width <= LARGEST_COORDINATE and 0 < frame.height <= LARGEST_COORDINATE):
            raise ValueError(
                f"frames[{i}] has size {frame.width}x{frame.height}; expected pixels, from 1 to "
                f"{LARGEST_COORDINATE:g}"
            )


def check_camera(camera: Camera) -> None:
    """Raises ValueError for an impossible focal length or principal point."""
    for name in ("fx", "fy"):
        if not 0 < getattr(camera, name) <= LARGEST_COORDINATE:
            raise ValueError(
                f"camera.{name} is {getattr(camera, name):g}; expected pixels, more than 0 and at "
                f"most {LARGEST_COORDINATE:g}"
            )
    for name in ("cx", "cy"):
        if not abs(getattr(camera, name)) <= LARGEST_COORDINATE:
            raise ValueError(
                f"camera.{name} is {getattr(camera, name):g}; expected pixels, at most "
                f"{LARGEST_COORDINATE:g}"
            )


def check_reach(values: Floats, name: str) -> None:
    """Raises ValueError for a number larger than ``LARGEST_COORDINATE``; null is ignored."""
    wild = np.abs(np.nan_to_num(values, nan=0.0)) > LARGEST_COORDINATE
    if wild.any():
        place = np.argwhere(wild)[0]
        where = "".join(f"[{i}]" for i in place)
        found = f"{name}{where} is {values[tuple(place)]:g}"
        raise ValueError(f"{found}; expected at most {LARGEST_COORDINATE:g}")


def check_motions(motions: tuple[Motion, ...], tracks: int, sets: int) -> None:
    """Raises ValueError for a motion with an invalid label, set, inliers or parameters."""
    for i, motion in enumerate(motions):
        name = f"motions[{i}]"
        if motion.label != i + 1:
            raise ValueError(f"{name}.label is {motion.label}; expected {i + 1}")
        _check_set_index(motion.set_index, sets, name)
        check_shape(motion.inliers, (None,), f"{name}.inliers")
        check_indices(motion.inliers, tracks, f"{name}.inliers", "tracks")
        if not np.isfinite(motion.parameters).all():
            raise ValueError(f"{name}.parameters holds null; expected numbers")


def check_modes(modes: tuple[Mode, ...], motions: int, sets: int) -> None:
    """Raises ValueError for a mode that refers to a set or a motion that does not exist."""
    for i, mode in enumerate(modes):
        name = f"modes[{i}]"
        _check_set_index(mode.set_index, sets, name)
        if not 0 <= mode.motion <= motions:
            raise ValueError(
                f"{name}.motion is {mode.motion}; expected 0 (none) to {motions}, the number of "
                "motions"
            )
        if not np.isfinite(mode.point).all():
            raise ValueError(f"{name}.point holds null; expected numbers")


def _check_set_index(index: int, sets: int, name: str) -> None:
    if not 0 <= index < sets:
        raise ValueError(f"{name}.set_index is {index}, but there are {sets} sets of hypotheses")
