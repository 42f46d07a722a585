"""What :func:`mssegment.segment_pictures` and :func:`mssegment.segment_tracks` return."""

from __future__ import annotations

import base64
import os
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
import numpy.typing as npt

from mssegment.configuration import Configuration
from mssegment.errors import UsageError
from mssegment.pipeline import Outcome
from mssegment.records import BACKGROUND, OUTLIER, Floats, Motion

if TYPE_CHECKING:
    from mssegment.rendering.report import Report
    from mssegment.results import Results


class FoundMotion(Motion, frozen=True):
    """A motion with the positions of its tracks.

    Attributes
    ----------
    inlier_points : ndarray [n, F, 2] of float64
        The positions of its tracks in pixels, NaN where a point is not visible.
    is_camera : bool
        Whether it is the motion of the static world under a moving camera.
    """

    inlier_points: Floats = msgspec.field(default_factory=lambda: np.zeros((0, 2, 2)))
    is_camera: bool = False

    def __repr__(self) -> str:
        """One line: the number, the model and the number of inliers."""
        name = ", the camera's" if self.is_camera else ""
        return f"Motion {self.label}{name}: {self.model}, {len(self.inliers)} inliers"


class Segmentation(Outcome, frozen=True):
    """Labels, motions and the documents of all stages.

    Attributes
    ----------
    configuration : Configuration
        All settings.
    """

    configuration: Configuration = Configuration()

    @property
    def motions(self) -> tuple[FoundMotion, ...]:
        """The motions, label 1 first."""
        camera = self.segmentation.camera_motion
        return tuple(
            FoundMotion(
                **{name: getattr(motion, name) for name in Motion.__struct_fields__},
                inlier_points=self.points[motion.inliers],
                is_camera=motion.label == camera,
            )
            for motion in self.segmentation.motions
        )

    def motion(self, label: int) -> FoundMotion:
        """The motion with a label; raises UsageError if there is none."""
        motions = self.motions
        if not 1 <= label <= len(motions):
            known = f"1 to {len(motions)}" if motions else "none: no motion was found"
            raise UsageError(f"label: there is no motion {label}; the labels are {known}")
        return motions[label - 1]

    @property
    def camera_motion(self) -> FoundMotion | None:
        """The motion of the static world under a moving camera, if it is known."""
        label = self.segmentation.camera_motion
        return None if label is None else self.motion(label)

    def __repr__(self) -> str:
        """One line: how many tracks, frames and motions."""
        tracks, frames = self.points.shape[:2]
        motions = ", ".join(
            f"{m.label}{' camera' if m.is_camera else ''}: {len(m.inliers)}" for m in self.motions
        )
        rest = [
            f"{name}: {count}"
            for name, label in (("outliers", OUTLIER), ("background", BACKGROUND))
            if (count := int((self.labels == label).sum()))
        ]
        found = "; ".join([motions or "no motion", *rest])
        return f"<Segmentation of {tracks} tracks over {frames} frames: {found}>"

    def _repr_html_(self) -> str:
        """The motions in the first frame and their table, for notebooks."""
        from mssegment.rendering.layout import view_of
        from mssegment.rendering.pictures import encode, frame_scene, motion_hulls
        from mssegment.rendering.tables import result_table

        report = self.report()
        view = view_of(report, 0)
        content = encode(frame_scene(report, view, motion_hulls(report, view)), "jpg")
        address = f"data:image/jpeg;base64,{base64.b64encode(content).decode()}"
        table = result_table(report)
        rows = "".join(
            "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>"
            for row in table.rows
        )
        header = "".join(f"<th>{escape(cell)}</th>" for cell in table.header)
        return (
            f'<img src="{address}" alt="{escape(repr(self))}" style="max-width:100%">'
            f"<table><thead><tr>{header}</tr></thead><tbody>{rows}</tbody></table>"
        )

    def report(self) -> Report:
        """What tables, pictures and the page show; with the true labels of ``report.labels``."""
        return self._results().report

    def to_dataframe(self) -> Any:
        """The columns of tracks.csv as a ``pandas.DataFrame``; raises UsageError without pandas.

        One row for each track in each frame that shows it: ``id``, ``frame``, ``x``, ``y``,
        ``motion``, ``residual_px`` (NaN without one) and ``inlier``.
        """
        try:
            import pandas
        except ImportError:
            raise UsageError(
                "to_dataframe: pandas is not installed; pip install 'mssegment[pandas]'"
            ) from None
        from mssegment.export.tracks import frame_numbers, own_residuals, track_ids

        report = self.report()
        track, frame = np.nonzero(report.tracks.visible)
        x, y = self.points[track, frame].T
        return pandas.DataFrame(
            {
                "id": np.array(track_ids(report), dtype=object)[track],
                "frame": np.array(frame_numbers(report))[frame],
                "x": x,
                "y": y,
                "motion": self.labels[track],
                "residual_px": own_residuals(report)[track],
                "inlier": self.labels[track] > 0,
            }
        )

    def masks(self) -> npt.NDArray[np.uint8]:
        """The motion of every pixel: [F, height, width].

        0 is the static world, 1, 2, ... the motions, 255 not known. Raises DataError without the
        pictures.
        """
        from mssegment.export import masks_of

        return np.stack(list(masks_of(self.report())))

    def plot(self, frame: int = 0, ax: Any = None) -> Any:
        """Draw the motions in one frame with matplotlib.

        Parameters
        ----------
        frame : int
            The position of the frame, from 0.
        ax : matplotlib.axes.Axes, optional
            Where to draw; by default new axes.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        UsageError
            Without matplotlib, or for a frame that there is not.
        """
        try:
            import matplotlib.pyplot as plt
        except ImportError:
            raise UsageError(
                "plot: matplotlib is not installed; pip install 'mssegment[plot]'"
            ) from None
        count = self.points.shape[1]
        if not 0 <= frame < count:
            raise UsageError(f"frame: there is no frame {frame}; expected 0 to {count - 1}")
        report = self.report()
        axes = plt.subplots()[1] if ax is None else ax
        picture = report.pictures(frame)
        size = report.frames[frame]
        if picture is None:
            axes.set(xlim=(-0.5, size.width - 0.5), ylim=(size.height - 0.5, -0.5))
            axes.set_aspect("equal")
        else:
            axes.imshow(picture[..., ::-1])
        for label in [*report.quiet_labels, *(motion.label for motion in report.objects)]:
            own = self.points[self.labels == label, frame]
            look = report.style(label)
            colour = [channel / 255 for channel in look.colour]
            if len(own):
                area = 4 if look.is_quiet else 16
                axes.scatter(own[:, 0], own[:, 1], s=area, color=colour, label=look.name)
        axes.legend(loc="upper right", fontsize="small")
        return axes

    def save(self, folder: str | os.PathLike[str], *, overwrite: bool = False) -> list[Path]:
        """Write what ``mssegment run`` writes: documents, report.json, pictures, the page.

        Parameters
        ----------
        folder
            Where; it is created if it does not exist.
        overwrite
            Write into a folder that is not empty.

        Returns
        -------
        list of Path
            The files. ``report.masks``, ``report.export`` and the other settings of the section
            ``report`` select them.

        Raises
        ------
        UsageError
            If the folder is not empty and ``overwrite`` is not set, or cannot be written.
        """
        from mssegment.folders import result_folder
        from mssegment.runs import write_files

        out = Path(folder)
        if out.is_file():
            raise UsageError(f"folder: {out} is a file; expected a folder")
        if out.is_dir() and any(out.iterdir()) and not overwrite:
            raise UsageError(f"folder: {out} is not empty; pass overwrite=True, or another folder")
        with result_folder(str(out), replace=overwrite) as written:
            results = self._results().with_masks()
            names = write_files(self, results, written, str(out))
        return [out / name for name in names]

    def _results(self) -> Results:
        from mssegment.results import Results

        return Results.of(self.segmentation, self.configuration, self.source)
