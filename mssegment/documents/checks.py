"""Validation of a document beyond its types: shapes, indices and ranges.

Each check raises ValueError with the name of the field, what was found and what was expected;
``documents.decode`` adds the name of the file.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from mssegment.inputs import limits
from mssegment.records import (
    IGNORED,
    LARGEST_COORDINATE,
    LARGEST_LABEL,
    Camera,
    Floats,
    Frame,
    HypothesisSet,
    Integers,
    Mode,
    Motion,
    Normalization,
    Part,
    Tracks,
)

LARGEST_COUNT = 2**53
"""Largest count or index: larger ones are not exact in every JSON reader."""
LARGEST_PARAMETER = 1e12
"""Largest number in a point on a manifold. Decompositions of far larger ones never end."""
BROWN_COUNTS = (0, 1, 2, 4, 5, 8, 12, 14)
"""Numbers of coefficients that have one meaning: OpenCV's, and k1 or k1, k2 alone."""


def check_inside(points: Floats, frame: Frame, name: str) -> None:
    """Raises ValueError for a position [n, 2] outside its frame, whose first pixel is at 0."""
    far = ((points < -0.5) | (points > np.array([frame.width, frame.height]) - 0.5)).any(axis=1)
    if far.any():
        corner = int(np.argmax(far))
        x, y = points[corner]
        raise ValueError(
            f"{name}[{corner}] is ({x:g}, {y:g}), outside the picture of {frame.width}x"
            f"{frame.height} pixels"
        )


def check_count(value: int, name: str) -> None:
    """Raises ValueError for a number of things that is negative or beyond ``LARGEST_COUNT``."""
    if not 0 <= value <= LARGEST_COUNT:
        raise ValueError(f"{name} is {value}; expected 0 to {LARGEST_COUNT}")


def check_point(point: Floats, sets: Sequence[HypothesisSet], index: int, name: str) -> None:
    """Raises ValueError unless a point has the shape of its set's manifold and finite numbers."""
    expected = sets[index].points.shape[1:]
    if point.shape != expected:
        raise ValueError(
            f"{name} has shape {_by(point.shape)}; expected {_by(expected)}, as the hypotheses of "
            f"sets[{index}]"
        )
    if not (np.abs(point) <= LARGEST_PARAMETER).all():
        raise ValueError(f"{name} holds null or a number beyond {LARGEST_PARAMETER:g}")


def _by(shape: tuple[int, ...]) -> str:
    return " x ".join(map(str, shape))


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


def check_tracks(tracks: Tracks, frames: list[Frame]) -> None:
    """Raises ValueError if the arrays of the tracks do not match the frames or each other."""
    pictures = are_pictures(frames)
    check_shape(tracks.points, (None, len(frames), 2 if pictures else None), "tracks.points")
    count = len(tracks.points)
    half_seen = np.isfinite(tracks.points).any(axis=-1) != np.isfinite(tracks.points).all(axis=-1)
    if half_seen.any():
        track, frame = np.argwhere(half_seen)[0]
        raise ValueError(
            f"tracks.points[{track}][{frame}] holds one number and one null; expected [x, y], or "
            "[null, null] where the point is not visible in that frame"
        )
    if pictures:
        check_reach(tracks.points, "tracks.points")
    if tracks.affines is not None:
        check_shape(tracks.affines, (count, 2, 2), "tracks.affines")
        check_reach(tracks.affines, "tracks.affines")
    if tracks.labels is not None:
        check_shape(tracks.labels, (count,), "tracks.labels")
        if count and not (tracks.labels.min() >= IGNORED and tracks.labels.max() <= LARGEST_LABEL):
            raise ValueError(
                f"tracks.labels range from {tracks.labels.min()} to {tracks.labels.max()}; "
                f"expected 0 (outlier), 1, 2, ..., at most {LARGEST_LABEL:,}"
            )
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


def are_pictures(frames: list[Frame]) -> bool:
    """Whether frames are pictures; those of other data have no size."""
    return all(frame.width for frame in frames)


def check_sets(sets: list[HypothesisSet], tracks: Tracks, frames: list[Frame]) -> None:
    """Raises ValueError if the arrays of a set do not match each other, the tracks or frames."""
    for i, chosen in enumerate(sets):
        name = f"sets[{i}]"
        if len(chosen.subsets) or len(chosen.points):
            check_shape(chosen.subsets, (len(chosen.points), None), f"{name}.subsets")
        check_indices(chosen.subsets, len(tracks.points), f"{name}.subsets", "tracks")
        wrong = next((frame for frame in chosen.frames if not 0 <= frame < len(frames)), None)
        if wrong is not None:
            raise ValueError(
                f"{name}.frames holds {wrong}; expected at least 0 and less than {len(frames)}, "
                "the number of frames"
            )
        check_count(chosen.drawn, f"{name}.drawn")
        if not np.isfinite(chosen.points).all():
            raise ValueError(f"{name}.points holds null; expected a number for every parameter")
        shape = (len(chosen.frames), tracks.points.shape[2])
        check_shape(chosen.normalization.centres, shape, f"{name}.normalization.centres")
        largest = LARGEST_COORDINATE if are_pictures(frames) else np.inf
        check_reach(chosen.points, f"{name}.points", largest)
        _check_normalization(chosen.normalization, f"{name}.normalization", largest)


def _check_normalization(normalization: Normalization, name: str, largest: float) -> None:
    if not np.isfinite(normalization.centres).all():
        raise ValueError(f"{name}.centres holds null; expected numbers")
    check_reach(normalization.centres, f"{name}.centres", largest)
    for field, value in (("scale", normalization.scale), ("aspect", normalization.aspect)):
        if not 0 < value <= largest or not np.isfinite(value):
            raise ValueError(
                f"{name}.{field} is {value:g}; expected more than 0 and at most {largest:g}"
            )
    if normalization.rotation is not None:
        check_shape(normalization.rotation, (3, 3), f"{name}.rotation")
        turn = normalization.rotation
        if not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6):
            raise ValueError(f"{name}.rotation is not orthogonal; expected a rotation matrix")


def check_texts(document: Any) -> None:
    """Raises ValueError for a text that is longer than ``limits.text_length``."""
    longest = limits.limit("text_length")
    for where, text in _texts(document):
        if len(text) > longest:
            raise ValueError(limits.exceeded("text_length", len(text), where))


def _texts(document: Any) -> Iterator[tuple[str, str]]:
    """Every text of a document with the name of its field."""
    for i, frame in enumerate(document.frames):
        yield f"frames[{i}].path", frame.path
        yield f"frames[{i}].sha256", frame.sha256
    for i, entry in enumerate(document.history):
        for text in (entry.stage, entry.version, *entry.notes, *map(str, entry.settings.values())):
            yield f"history[{i}]", text
    for name in ("notes", "sets", "motions"):
        for i, own in enumerate(getattr(document, name, ())):
            for text in (
                (own,) if isinstance(own, str) else (own.model, getattr(own, "manifold", ""))
            ):
                yield f"{name}[{i}]", text
    for i, text in enumerate(getattr(getattr(document, "tracks", None), "ids", None) or ()):
        yield f"tracks.ids[{i}]", text


def check_frames(frames: list[Frame]) -> None:
    """Raises ValueError for a frame without a valid size, or with an impossible index or time."""
    for i, frame in enumerate(frames):
        if frame.index is not None and not 0 <= frame.index <= LARGEST_COUNT:
            raise ValueError(f"frames[{i}].index is {frame.index}; expected 0 to {LARGEST_COUNT}")
        if not frame.width and not frame.height:
            continue  # data that is no picture
        if not (0 < frame.width <= LARGEST_COORDINATE and 0 < frame.height <= LARGEST_COORDINATE):
            raise ValueError(
                f"frames[{i}] has size {frame.width}x{frame.height}; expected pixels, from 1 to "
                f"{LARGEST_COORDINATE:g}"
            )
    if len({bool(frame.width) for frame in frames}) > 1:
        raise ValueError("frames holds pictures and data without a size; expected one kind")


def check_camera(camera: Camera) -> None:
    """Raises ValueError for an impossible focal length, principal point or distortion."""
    count = len(camera.distortion)
    if camera.distortion_model == "fisheye" and count > 4:
        raise ValueError(
            f"camera.distortion has {count} coefficients of a fisheye lens; expected k1, k2, k3, k4"
        )
    if camera.distortion_model == "brown" and count not in BROWN_COUNTS:
        raise ValueError(
            f"camera.distortion has {count} coefficients; expected k1, k2, p1, p2[, k3[, k4, k5, "
            "k6[, s1, s2, s3, s4[, tau_x, tau_y]]]], with 0 for those that are not known"
        )
    if not all(abs(value) <= LARGEST_COORDINATE for value in camera.distortion):
        raise ValueError(
            f"camera.distortion holds {max(camera.distortion, key=abs):g}; expected at most "
            f"{LARGEST_COORDINATE:g}"
        )
    for name, size in (("width", camera.width), ("height", camera.height)):
        if size is not None and not 0 < size <= LARGEST_COORDINATE:
            raise ValueError(f"camera.{name} is {size}; expected pixels, more than 0")
    for name in ("fx", "fy"):
        # below, coordinates in units of the focal length would overflow
        if not 1 / LARGEST_COORDINATE <= getattr(camera, name) <= LARGEST_COORDINATE:
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


def check_reach(values: Floats, name: str, largest: float = LARGEST_COORDINATE) -> None:
    """Raises ValueError for a number larger than ``largest``; null is ignored."""
    wild = np.abs(np.nan_to_num(values, nan=0.0)) > largest
    if wild.any():
        place = np.argwhere(wild)[0]
        where = "".join(f"[{i}]" for i in place)
        found = f"{name}{where} is {values[tuple(place)]:g}"
        raise ValueError(f"{found}; expected at most {largest:g}")


def check_motions(motions: tuple[Motion, ...], tracks: int, sets: Sequence[HypothesisSet]) -> None:
    """Raises ValueError for a motion with an invalid label, set, inliers or parameters."""
    for i, motion in enumerate(motions):
        name = f"motions[{i}]"
        if motion.label != i + 1:
            raise ValueError(f"{name}.label is {motion.label}; expected {i + 1}")
        named: list[tuple[str, Motion | Part]] = [(name, motion)]
        named += [(f"{name}.parts[{k}]", part) for k, part in enumerate(motion.parts)]
        for own, part in named:
            _check_set_index(part.set_index, len(sets), own)
            check_shape(part.inliers, (None,), f"{own}.inliers")
            check_indices(part.inliers, tracks, f"{own}.inliers", "tracks")
            check_point(part.parameters, sets, part.set_index, f"{own}.parameters")
            if not 0 <= part.rms < math.inf:
                raise ValueError(f"{own}.rms is {part.rms:g}; expected pixels, at least 0")


def check_modes(modes: tuple[Mode, ...], motions: int, sets: Sequence[HypothesisSet]) -> None:
    """Raises ValueError for a mode with an invalid set, motion, density or point."""
    for i, mode in enumerate(modes):
        name = f"modes[{i}]"
        _check_set_index(mode.set_index, len(sets), name)
        if not 0 <= mode.motion <= motions:
            raise ValueError(
                f"{name}.motion is {mode.motion}; expected 0 (none) to {motions}, the number of "
                "motions"
            )
        check_count(mode.hypotheses, f"{name}.hypotheses")
        if not 0 <= mode.kde < math.inf:
            raise ValueError(f"{name}.kde is {mode.kde:g}; expected a density, at least 0")
        check_point(mode.point, sets, mode.set_index, f"{name}.point")


def check_assignments(
    assignments: tuple[Integers, ...], modes: int, sets: Sequence[HypothesisSet]
) -> None:
    """Raises ValueError for assignments of hypotheses to modes that do not exist."""
    for i, (own, chosen) in enumerate(zip(assignments, sets, strict=False)):
        check_shape(own, (len(chosen.points),), f"assignments[{i}]")
        if own.size and (own.min() < -1 or own.max() >= max(modes, 1)):
            raise ValueError(
                f"assignments[{i}] range from {own.min()} to {own.max()}; expected -1 (none) to "
                f"{modes - 1}, the last mode"
            )


def _check_set_index(index: int, sets: int, name: str) -> None:
    if not 0 <= index < sets:
        raise ValueError(f"{name}.set_index is {index}, but there are {sets} sets of hypotheses")
