"""The files of a segmentation: report.json, report.html, pictures, masks, tables, a video."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import numpy.typing as npt

from mssegment.configuration import Configuration
from mssegment.documents import Document, SegmentationDocument, write_bytes
from mssegment.errors import DataError
from mssegment.pipeline import straight
from mssegment.records import Record, field, replace
from mssegment.rendering.report import Picture, Report, build_report
from mssegment.rendering.report_json import report_bytes

if TYPE_CHECKING:
    from mssegment.ground_truth import Truth
    from mssegment.imaging.frames import FrameSource


class Results(Record, frozen=True):
    """A report, and the configuration that selects what is written."""

    report: Report
    configuration: Configuration
    truth: Truth | None = None
    masks: dict[str, bytes] = field(default_factory=dict)
    """Files of masks by their path below the folder of the results."""
    said: list[str] = field(default_factory=list)
    """What ``write`` says of the files that it wrote."""

    @classmethod
    def of(
        cls,
        document: SegmentationDocument,
        configuration: Configuration,
        source: FrameSource | None = None,
    ) -> Results:
        """The results of a segmentation.

        Parameters
        ----------
        document : SegmentationDocument
            The segmentation.
        configuration : Configuration
            Its section ``report`` selects the labels and what is written.
        source : FrameSource, optional
            The opened images; by default they are read from the paths in the document.

        Returns
        -------
        Results

        Raises
        ------
        DataError
            If the labels cannot be read or match no track.
        """
        settings = configuration.report
        truth = None
        if settings.labels:
            from mssegment.ground_truth import read_truth

            truth = read_truth(
                settings.labels, document.tracks, document.frames, settings.label_radius
            )
        report = build_report(
            frames=document.frames,
            tracks=document.tracks,
            sets=document.sets,
            segmentation=document.segmentation,
            pictures=FramePictures(document, source),
            truth=None if truth is None else truth.labels,
            background_label=settings.background_label,
            evaluation_notes=() if truth is None else (truth.note, *truth.notes),
            straight=straight(document.tracks.points, document.camera),
            history=[msgspec.structs.asdict(entry) for entry in document.history],
            configuration=msgspec.to_builtins(configuration),
        )
        return cls(report, configuration, truth)

    def with_masks(self) -> Results:
        """The results with masks, compared with the true ones where there are any.

        Without masks if they are not asked for. Raises DataError without the pictures.
        """
        if not self.configuration.report.masks:
            return self
        from mssegment.export import mask_files, masks_of
        from mssegment.masks.quality import mask_quality

        true_masks = {} if self.truth is None else self.truth.masks
        # where the true masks have the static world as an object
        camera = self.report.camera_motion
        world = camera if camera and self.report.true_motion(camera) else 0
        kept: dict[int, npt.NDArray[np.uint8]] = {}

        def passing() -> Iterator[npt.NDArray[np.uint8]]:
            for index, mask in enumerate(masks_of(self.report)):
                if index in true_masks:
                    kept[index] = np.where(mask == 0, world, mask) if world else mask
                yield mask

        style = self.configuration.report.mask_style
        files = dict(mask_files(self.report, style, passing()))
        if style == "colmap" and all(frame.index is not None for frame in self.report.frames):
            self.said.append(
                "masks for COLMAP are called as the pictures of a video that `ffmpeg -i VIDEO "
                "-start_number 0 -fps_mode passthrough %05d.png` takes out of it, with .png added"
            )
        quality = mask_quality(kept, true_masks) if kept else ()
        return replace(self, masks=files, report=replace(self.report, mask_quality=quality))

    def write(self, out: str) -> list[str]:
        """Write report.json and the selected files into the folder ``out``; their names."""
        written = {"report.json": report_bytes(self.report)}
        settings = self.configuration.report
        if settings.pictures:
            from mssegment.rendering.pictures import USUAL, render_pictures

            kinds = (*USUAL, "regions") if settings.regions else USUAL
            written |= render_pictures(self.report, settings.picture_format, kinds)
        if settings.video:
            from mssegment.rendering.video import make_video

            video = make_video(self.report)
            written["motions.mp4"] = video.content
            self.said.append(video.description)
        if settings.export:
            from mssegment.export import export

            written |= export(self.report, settings.export)
        written |= self.masks
        if settings.html:
            from mssegment.rendering.page import render_page

            written["report.html"] = render_page(self.report).encode()
        for name, content in written.items():
            path = Path(out) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(str(path), content)
        return list(written)


class FramePictures:
    """The image of a frame in BGR order, or None if its file is not available.

    The images of imported tracks are those that they were put on, or those inside their file, if
    any (AdelaideRMF).
    """

    def __init__(self, document: Document, source: FrameSource | None = None) -> None:
        self._frames = document.frames
        self._imported = is_file_of_tracks(document)
        self._red_first: Callable[[int], Picture | None] | None = None
        if source is not None:
            self._red_first = source.colour

    def __call__(self, index: int) -> Picture | None:
        """The image of a frame by its index."""
        if self._red_first is None:
            self._red_first = self._inside_the_file() if self._imported else self._opened()
        picture = self._red_first(index)
        return None if picture is None else picture[..., ::-1]

    def _opened(self) -> Callable[[int], Picture | None]:
        from mssegment.imaging.frames import reopen_frames

        try:
            return reopen_frames(self._frames).colour
        except DataError:
            # a document from another machine: the points are drawn without the image
            return lambda index: None

    def _inside_the_file(self) -> Callable[[int], Picture | None]:
        from mssegment.datasets import read

        try:
            pictures = read(self._frames[0].path).pictures
        except DataError:
            pictures = ()
        return lambda index: pictures[index] if index < len(pictures) else None


def is_file_of_tracks(document: Document) -> bool:
    """Whether the frames are those of a file of tracks, and not pictures."""
    if not document.frames or not any(entry.stage == "import" for entry in document.history):
        return False
    from mssegment.datasets.containers import holds_data
    from mssegment.imaging.pictures import looks_like_picture

    path = document.frames[0].path
    try:
        with Path(path).open("rb") as file:
            head = file.read(1024)
    except OSError:
        return True
    return holds_data(path, head) and not looks_like_picture(path, head)
