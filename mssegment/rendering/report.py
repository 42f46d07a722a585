"""What tables, pictures and the page show, gathered once.

``build_report`` compares the labels with the true ones and computes the residual errors (23) and
(24) of the paper.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from mssegment.evaluation import Evaluation, evaluate, find_world, residual_errors
from mssegment.inputs.text import printable
from mssegment.records import (
    BACKGROUND,
    NOT_JUDGED,
    OUTLIER,
    ClusterResult,
    Floats,
    Frame,
    HypothesisSet,
    Integers,
    Mode,
    Motion,
    Record,
    Tracks,
    replace,
)
from mssegment.rendering.style import LabelStyle, camera_style, label_style

if TYPE_CHECKING:
    from mssegment.masks.quality import MaskQuality

BackgroundRule = Literal["auto", "none", "motion"]
Picture = npt.NDArray[np.uint8]
"""A picture [height, width, 3] in BGR order."""
PictureOf = Callable[[int], Picture | None]
"""The picture of a frame by its index, or None where it is not available."""


def no_picture(index: int) -> None:
    """The ``PictureOf`` of a report without pictures."""


class Report(Record, frozen=True, eq=False):
    """A segmentation with everything that is shown of it.

    Parameters
    ----------
    frames : tuple of Frame
        The frames.
    tracks : Tracks
        The P tracks.
    sets : tuple of HypothesisSet
        The hypotheses.
    segmentation : ClusterResult
        Modes, motions and labels.
    pictures : callable
        Gives the picture of a frame by its index, or None.
    truth : int array [P], optional
        True labels.
    evaluation : Evaluation, optional
        Comparison of the labels with the true ones.
    res, res_hat : tuple of (float or None), optional
        Residual errors (23) and (24) of the motions by label, None for a motion without true
        counterpart.
    history : tuple of mapping
        The stages with their settings and notes.
    configuration : mapping
        All settings.
    trajectories : tuple of tuple of float array [steps, ...]
        Mean shift trajectories on the manifold of each hypothesis set.
    evaluation_notes : tuple of str
        What the comparison with the true labels is based on.
    mask_quality : tuple of MaskQuality
        J and F of the masks of each true object, where both were made.
    data : float array [P, F, d], optional
        Data that is no picture; ``tracks`` are then its points in the pixels of a view.
    """

    frames: tuple[Frame, ...]
    tracks: Tracks
    sets: tuple[HypothesisSet, ...]
    segmentation: ClusterResult
    pictures: PictureOf = no_picture
    truth: Integers | None = None
    evaluation: Evaluation | None = None
    res: tuple[float | None, ...] | None = None
    res_hat: tuple[float | None, ...] | None = None
    history: tuple[Mapping[str, Any], ...] = ()
    configuration: Mapping[str, Any] = {}
    trajectories: tuple[tuple[Floats, ...], ...] = ()
    evaluation_notes: tuple[str, ...] = ()
    mask_quality: tuple[MaskQuality, ...] = ()
    data: Floats | None = None

    @property
    def of_pictures(self) -> bool:
        """Whether the tracks are positions in pictures, and not data that is drawn as one."""
        return self.data is None

    @property
    def unit(self) -> str:
        """The unit of residuals, in tables: pixels, or that of the data."""
        return "px" if self.of_pictures else ""

    @property
    def noun(self) -> str:
        """What a label stands for."""
        return "motion" if self.of_pictures else "structure"

    @property
    def things(self) -> str:
        """What has a label, in the plural."""
        return "tracks" if self.of_pictures else "points"

    @property
    def labels(self) -> Integers:
        """The label of every track, [P]."""
        return self.segmentation.labels

    @property
    def motions(self) -> tuple[Motion, ...]:
        """The motions, sorted by label."""
        return tuple(sorted(self.segmentation.motions, key=lambda motion: motion.label))

    @property
    def notes(self) -> tuple[str, ...]:
        """The notes of all stages in their order, each once, fit to be shown."""
        said = [str(note) for stage in self.history for note in stage.get("notes", ())]
        said += [*self.segmentation.notes, *self.evaluation_notes]
        return tuple(printable(note) for note in dict.fromkeys(said))

    @property
    def camera_motion(self) -> int | None:
        """The label of the motion of the static world under a moving camera, if it is known."""
        return self.segmentation.camera_motion

    def style(self, label: int) -> LabelStyle:
        """How a label is shown."""
        if label == self.camera_motion:
            return camera_style(label)
        found = label_style(label)
        named = label > 0 and not self.of_pictures
        return replace(found, name=f"structure {label}") if named else found

    @property
    def objects(self) -> tuple[Motion, ...]:
        """The motions without that of the static world, sorted by label."""
        return tuple(motion for motion in self.motions if motion.label != self.camera_motion)

    @property
    def quiet_labels(self) -> tuple[int, ...]:
        """The labels that are drawn small and behind the objects."""
        camera = () if self.camera_motion is None else (self.camera_motion,)
        return (BACKGROUND, NOT_JUDGED, OUTLIER, *camera)

    def members(self, label: int) -> Integers:
        """Indices of the tracks with this label."""
        return np.flatnonzero(self.labels == label)

    def modes_of(self, label: int) -> list[Mode]:
        """The modes of a motion: those of its own hypothesis set first, strongest first."""
        own = {motion.label: motion.set_index for motion in self.segmentation.motions}.get(label)
        modes = [mode for mode in self.segmentation.modes if mode.motion == label]
        return sorted(modes, key=lambda mode: (mode.set_index != own, -mode.kde))

    def true_motion(self, label: int) -> int | None:
        """The true motion that is matched with a motion, None without one."""
        if self.evaluation is None:
            return None
        return 0 if label == self.evaluation.world else self.evaluation.matching.get(label)


def build_report(
    *,
    frames: Sequence[Frame],
    tracks: Tracks,
    sets: Sequence[HypothesisSet],
    segmentation: ClusterResult,
    pictures: PictureOf | None = None,
    truth: Integers | None = None,
    straight: Floats | None = None,
    history: Sequence[Mapping[str, Any]] = (),
    configuration: Mapping[str, Any] | None = None,
    trajectories: Sequence[Sequence[Floats]] = (),
    background_label: BackgroundRule = "auto",
    evaluation_notes: Sequence[str] = (),
    mask_quality: Sequence[MaskQuality] = (),
) -> Report:
    """Gather a report.

    Parameters
    ----------
    frames, tracks, sets, segmentation, pictures, history, configuration, trajectories
        As in ``Report``; so are ``evaluation_notes`` and ``mask_quality``.
    background_label : {"auto", "none", "motion"}
        What the true label 0 is (``evaluation.find_world``).
    truth : int array [P], optional
        True labels; by default those of ``tracks``.
    straight : float array [P, F, 2], optional
        The tracks without lens distortion, in pixels, to which the models were fitted. By default
        those of ``tracks``.

    Returns
    -------
    Report

    Raises
    ------
    ValueError
        If there are not as many true labels as tracks.
    """
    truth = tracks.labels if truth is None else truth
    undistorted = tracks.points if straight is None else straight
    evaluation = res = res_hat = None
    if truth is not None:
        found = segmentation.labels
        world = find_world(found, truth, segmentation.camera_motion, background_label)
        evaluation = evaluate(found, truth, world)
        evaluation_notes = [*evaluation_notes, *_world_notes(segmentation, truth, world)]
        errors = [
            _residual_errors(
                motion, sets, undistorted, truth, evaluation.matching.get(motion.label)
            )
            for motion in sorted(segmentation.motions, key=lambda motion: motion.label)
        ]
        res = tuple(error[0] for error in errors)
        res_hat = tuple(error[1] for error in errors)
    data = None
    if frames and not frames[0].width:
        from mssegment.rendering.data_view import data_display

        data = tracks.points
        frames, tracks, pictures = data_display(data, tracks, frames, segmentation.labels)
    return Report(
        frames=tuple(frames),
        tracks=tracks,
        sets=tuple(sets),
        segmentation=segmentation,
        data=data,
        pictures=pictures or no_picture,
        truth=truth,
        evaluation=evaluation,
        res=res,
        res_hat=res_hat,
        history=tuple(history),
        configuration=dict(configuration or {}),
        trajectories=tuple(tuple(paths) for paths in trajectories),
        evaluation_notes=tuple(evaluation_notes),
        mask_quality=tuple(mask_quality),
    )


def _world_notes(
    segmentation: ClusterResult, truth: Integers, world: int | None
) -> tuple[str, ...]:
    """What the true label 0 was taken for, where that is not obvious."""
    own = segmentation.labels[truth == OUTLIER]
    if world == BACKGROUND:
        return ("label 0 is the static world: the background is right there",)
    if world is not None:
        name = "the camera's motion" if world == segmentation.camera_motion else "the motion"
        return (f"label 0 is the static world: {name} ({world}) is right there",)
    labels, counts = np.unique(own[own > 0], return_counts=True)
    if not len(labels) or 2 * counts.max() <= len(own):
        return ()
    return (
        f"label 0 counts as outlier, but most of its tracks are in motion {labels[counts.argmax()]}"
        "; if 0 is the static world, set report.background_label to motion",
    )


def _residual_errors(
    motion: Motion,
    sets: Sequence[HypothesisSet],
    points: Floats,
    truth: Integers,
    true_label: int | None,
) -> tuple[float | None, float | None]:
    """Equation (23) for the motion, and (24) for the least-squares fit to the true inliers."""
    if true_label is None or motion.set_index >= len(sets):
        return None, None
    from mssegment.models import of_set

    chosen = sets[motion.set_index]
    model = of_set(chosen)
    if motion.parameters.shape != model.manifold.point_shape:
        return None, None
    points = points[:, list(chosen.frames)]
    inliers = np.flatnonzero((truth == true_label) & np.isfinite(points).all(axis=(1, 2)))
    if len(inliers) < model.subset_size:
        return None, None
    observed = model.observe(points[inliers], chosen.normalization)
    labels = np.full(len(inliers), true_label)

    def error(parameters: Floats) -> float:
        """The residual error of a motion over the true inliers."""
        residuals = model.algebraic_residuals(parameters, observed, chosen.normalization)[0]
        return residual_errors(residuals, labels, true_label)

    res = error(motion.parameters[None])
    fitted, valid = model.algebraic_fit(observed, np.ones((1, len(inliers))))
    return res, error(fitted) if valid[0] else None
