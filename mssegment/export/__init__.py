"""Results as files of other people's tools: masks, and tables of trajectories.

A format of trajectories is one module with an ``Export``, and one line in ``EXPORTS`` of
``registry.py``; a style of masks is a function in ``mask_styles``, and one line in ``MASK_STYLES``.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import numpy as np
import numpy.typing as npt

from mssegment.records import Record
from mssegment.registry import EXPORTS, MASK_STYLES
from mssegment.rendering.report import Report

__all__ = ["EXPORTS", "MASK_STYLES", "Export", "Mask", "MaskStyle", "export", "mask_files"]

Mask = npt.NDArray[np.uint8]
"""[height, width]: 0 the static world, 1.. motions, 255 not known."""
MaskStyle = Callable[[Report, Iterable[Mask]], Iterator[tuple[str, bytes]]]
"""From a report and the masks of its frames to files: names below the folder, and contents."""


class Export(Record, frozen=True):
    """A format of trajectories.

    Attributes
    ----------
    file : str
        The name of the file.
    description : str
        What is in it, for help texts.
    content : callable
        The bytes of the file, from a report.
    of_pictures : bool
        Whether it is one of tracks in pictures, and not of other data.
    """

    file: str
    description: str
    content: Callable[[Report], bytes]
    of_pictures: bool = True


def export(report: Report, names: Iterable[str]) -> dict[str, bytes]:
    """Write trajectories in some formats of ``EXPORTS``: file name to content."""
    chosen = [EXPORTS[name] for name in dict.fromkeys(names)]
    return {each.file: each.content(report) for each in chosen}


def masks_of(report: Report) -> Iterator[Mask]:
    """The masks of the frames of a report, in order; raises DataError without their pictures."""
    from mssegment.masks import label_pixels

    return label_pixels(
        report.tracks.points, report.labels, report.frames, report.pictures, report.camera_motion
    )


def mask_files(
    report: Report, style: str = "davis", masks: Iterable[Mask] | None = None
) -> Iterator[tuple[str, bytes]]:
    """Write the masks of a report in a style of ``MASK_STYLES``.

    Parameters
    ----------
    report : Report
        The segmentation.
    style : str
        A name in ``MASK_STYLES``.
    masks : iterable of ndarray, optional
        The masks of the frames; by default they are computed.

    Yields
    ------
    name : str
        The path of a file below the folder of the results.
    content : bytes
        Its content.
    """
    write: MaskStyle = MASK_STYLES[style]
    yield from write(report, masks_of(report) if masks is None else masks)
