"""A long clip from its frames to the files of its windows.

Three things happen at the same time: one thread decodes frames and detects their corners, this one
follows the tracks, and another one segments the windows that are full and writes their files.
"""

from __future__ import annotations

import contextvars
import queue
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mssegment.clips.choice import limits_of
from mssegment.clips.objects import objects_of
from mssegment.clips.segment import SegmentedWindow, segment_window
from mssegment.clips.store import ClipState, ClipStore, LiveTracks
from mssegment.clips.windows import FullWindow, WindowBuilder
from mssegment.configuration import Configuration
from mssegment.documents.clips import (
    ClipDocument,
    WindowDocument,
    WindowMotion,
    WindowTracks,
)
from mssegment.errors import DataError
from mssegment.history import entry_of
from mssegment.imaging.corners import DISTANCE_SEQUENCE, LIMIT_SEQUENCE, QUALITY, detect
from mssegment.imaging.pictures import white_level
from mssegment.imaging.streams import Clip, grey_bytes, in_background
from mssegment.imaging.threads import threads_beside
from mssegment.imaging.tracking import FramePoints, StreamTracker, TrackerState
from mssegment.progress import listening, report
from mssegment.records import BACKGROUND, Floats, Frame, Motion, Record, replace
from mssegment.sequences.history import STATIC_WORLD
from mssegment.sequences.identities import IdentityTracker, WindowIdentities, WindowLabels

Bytes = npt.NDArray[np.uint8]
WAITING_WINDOWS = 2
"""Windows that wait to be segmented; with more, tracking waits."""


def process(
    clip: Clip,
    configuration: Configuration,
    folder: Path,
    on_window: Callable[[WindowDocument], None] = lambda window: None,
) -> ClipDocument:
    """Segment a clip window by window.

    Parameters
    ----------
    clip : Clip
        The frames.
    configuration : Configuration
        The settings.
    folder : Path
        Where the files go. If it holds the state of the same clip, interrupted, that is continued.
    on_window : callable
        Called with the document of each window when its files are written.

    Returns
    -------
    ClipDocument
        It is written too.

    Raises
    ------
    DataError
        If a frame cannot be read.
    """
    store = ClipStore(folder)
    with threads_beside(2):
        worker = _Worker(store, configuration, store.read_state(), on_window)
        try:
            count = _track(clip, configuration, worker)
            worker.finish()
        except BaseException:
            worker.stop()
            raise
    document = _summary(clip, configuration, store, worker, count)
    store.write_clip(document)
    return document


class _SeenFrame(Record, frozen=True):
    """A frame as the reader passes it on."""

    frame: Frame
    grey: Bytes
    corners: Floats


def _read(clip: Clip, configuration: Configuration, first: int) -> Iterator[_SeenFrame]:
    """Frames from ``first`` on, with their corners."""
    settings = configuration.detect
    white = 255.0
    for number, (frame, picture) in enumerate(clip.frames(first)):
        if number == 0:
            white = white_level(picture)
        grey = grey_bytes(picture, white)
        corners = detect(
            grey.astype(np.float32),
            levels=1 if settings.levels == "auto" else settings.levels,
            limit=LIMIT_SEQUENCE if settings.max_corners == "auto" else settings.max_corners,
            distance=(
                DISTANCE_SEQUENCE if settings.min_distance == "auto" else settings.min_distance
            ),
            quality=QUALITY if settings.quality == "auto" else settings.quality,
            even=True,
        )
        yield _SeenFrame(frame, grey, corners.points)


def _track(clip: Clip, configuration: Configuration, worker: _Worker) -> int:
    """Follow the tracks, and hand over each full window; the number of frames."""
    builder = WindowBuilder(limits_of(configuration), worker.windows, worker.start)
    tracker: StreamTracker | None = None
    number = worker.start
    recent: list[FramePoints] = []
    earlier: list[tuple[Bytes, FramePoints]] = []
    if worker.resumed is not None:
        resumed = worker.resumed
        recent = _live(resumed.recent)
        builder.begin(resumed.frames, _live(resumed.shared), recent)
        number += len(resumed.shared) - len(recent)
    for seen in in_background(_read(clip, configuration, number)):
        number += 1
        if len(earlier) < len(recent):  # the window has these frames already
            earlier.append((seen.grey, recent[len(earlier)]))
            if worker.resumed is not None and len(earlier) == len(recent):
                state = TrackerState(recent[-1], worker.resumed.next_track)
                tracker = StreamTracker(seen.grey, seen.corners, state, earlier[:-1])
            continue
        if tracker is not None:
            points_here = tracker.step(seen.grey, seen.corners)
        else:
            tracker = StreamTracker(seen.grey, seen.corners)
            points_here = tracker.state.live
        report(number, None, "frames")
        full = builder.add(seen.frame, points_here, tracker.state.next_track)
        if full is not None:
            worker.put(full)
    if tracker is None:
        raise DataError(f"{clip.paths[0]}: no frames")
    worker.put(builder.rest(tracker.state.next_track))
    return number


def _live(tracks: Sequence[LiveTracks]) -> list[FramePoints]:
    """The tracks of some frames, as they were before they were stored."""
    return [FramePoints(own.tracks, own.points.astype(np.float32)) for own in tracks]


def _stored(points: Sequence[FramePoints]) -> list[LiveTracks]:
    return [LiveTracks(own.tracks, own.points.astype(np.float64)) for own in points]


class _Worker:
    """Segments windows in their order, in a thread, and writes their files."""

    def __init__(
        self,
        store: ClipStore,
        configuration: Configuration,
        resumed: ClipState | None,
        on_window: Callable[[WindowDocument], None],
    ) -> None:
        self.resumed = resumed
        self._store, self._configuration, self._on_window = store, configuration, on_window
        self.windows = 0 if resumed is None else resumed.windows
        self.start = 0 if resumed is None else resumed.start
        self._background = np.zeros(0, np.int64) if resumed is None else resumed.background
        self._identities = None if resumed is None else resumed.identities
        self._waiting: queue.Queue[FullWindow | None] = queue.Queue(WAITING_WINDOWS)
        self._error: BaseException | None = None
        self._stopped = threading.Event()
        context = contextvars.copy_context()
        self._thread = threading.Thread(
            target=context.run, args=(self._run,), name="segmentation", daemon=True
        )
        self._thread.start()

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the frames."""
        return (0, 0) if self._identities is None else self._identities.size

    def put(self, window: FullWindow) -> None:
        """Hand over a window; waits while too many are waiting."""
        while True:
            if self._error is not None:
                raise self._error
            try:
                self._waiting.put(window, timeout=0.1)
                return
            except queue.Full:
                continue

    def finish(self) -> None:
        """Wait for all windows."""
        while self._thread.is_alive():
            try:
                self._waiting.put(None, timeout=0.1)
                break
            except queue.Full:
                continue
        self._thread.join()
        if self._error is not None:
            raise self._error

    def stop(self) -> None:
        """End after the window that is being segmented."""
        self._stopped.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            with listening(lambda done, total, what: None):  # frames are counted, nothing else
                self._all()
        except BaseException as error:
            self._error = error

    def _all(self) -> None:
        while not self._stopped.is_set():
            try:
                window = self._waiting.get(timeout=0.1)
            except queue.Empty:
                continue
            if window is None:
                return
            self._one(window)

    def _one(self, window: FullWindow) -> None:
        if self._identities is None:
            frame = window.frames[0]
            self._identities = IdentityTracker((frame.width, frame.height))
        earlier_background = np.isin(window.tracks, self._background)
        seen_before = self._identities.history.usual(window.tracks) >= STATIC_WORLD
        found = segment_window(
            window.points,
            window.frames,
            self._configuration,
            earlier_background=earlier_background,
            moved_before=seen_before & ~earlier_background,
        )
        found = _separated(window, found, self._identities)
        joined = self._identities.add(_labels(window, found))
        self._background = window.tracks[found.labels == BACKGROUND]
        document = _document(window, found, joined)
        own = window.points[:, : window.own]
        shown = found.shown[:, : window.own]
        self._store.write_window(
            document,
            WindowTracks.of(
                window.start,
                window.tracks,
                own,
                np.where(shown, found.labels[:, None], BACKGROUND),
                np.where(shown, joined.tracks[:, None], STATIC_WORLD),
                _matrices(found.motions, len(window.frames)),
            ),
        )
        self._store.write_state(self._state(window))
        self.windows = window.index + 1
        self._on_window(document)

    def _state(self, window: FullWindow) -> ClipState:
        assert self._identities is not None
        return ClipState(
            windows=window.index + 1,
            start=window.start + window.own,
            frames=list(window.frames[window.own :]),
            shared=_stored(window.shared),
            recent=_stored(window.recent),
            next_track=window.next_track,
            background=self._background,
            identities=self._identities,
        )


def _labels(window: FullWindow, found: SegmentedWindow) -> WindowLabels:
    """What identities are made of: tracks while they move with their motion."""
    points = np.where(found.shown[..., None], window.points, np.nan)
    return WindowLabels(window.start, window.tracks, points, found.labels, found.camera_motion)


def _separated(
    window: FullWindow, found: SegmentedWindow, identities: IdentityTracker
) -> SegmentedWindow:
    """The same with objects that have been two as two motions, before a static camera."""
    if not found.is_static:
        return found
    labels, sources = identities.separated(_labels(window, found))
    motions = [*found.motions, *(found.motions[source - 1] for source in sources)]
    own = [
        replace(motion, label=label, inliers=np.flatnonzero(labels == label))
        for label, motion in enumerate(motions, start=1)
    ]
    return replace(found, labels=labels, motions=tuple(own))


def _matrices(motions: Sequence[Motion], frames: int) -> Floats:
    """The maps [m, frames, 3, 3] of the motions, NaN where there is none."""
    found = np.full((len(motions), frames, 3, 3), np.nan)
    for own, motion in zip(found, motions, strict=True):
        if motion.matrix is not None and motion.matrix.shape == own.shape:
            own[:] = motion.matrix
    return found


def _document(
    window: FullWindow, found: SegmentedWindow, joined: WindowIdentities
) -> WindowDocument:
    motions = []
    for motion, identity in zip(found.motions, joined.motions, strict=True):
        members = found.labels == motion.label
        shown = np.flatnonzero(found.shown[members].any(axis=0))
        motions.append(
            WindowMotion(
                label=motion.label,
                identity=identity,
                model=motion.model,
                tracks=int(members.sum()),
                rms=motion.rms,
                first=window.start + int(shown[0]),
                last=window.start + int(shown[-1]),
            )
        )
    return WindowDocument(
        index=window.index,
        start=window.start,
        stop=window.start + len(window.frames),
        own_stop=window.start + window.own,
        camera="static" if found.is_static else "moving",
        strategy=found.strategy,
        motions=motions,
        resting=list(joined.resting),
        origins=joined.origins,
        merged=joined.merged,
        times=[frame.time for frame in window.frames[: window.own]],
        notes=list(found.notes),
    )


def _summary(
    clip: Clip, configuration: Configuration, store: ClipStore, worker: _Worker, count: int
) -> ClipDocument:
    """The document of the whole clip, from the files of its windows."""
    spans: list[tuple[int, int]] = []
    cameras: list[str] = []
    times: list[float | None] = []
    positions = tracks_seen = 0
    last_track = -1

    def passing() -> Iterator[tuple[WindowDocument, WindowTracks]]:
        nonlocal positions, tracks_seen, last_track
        for document, tracks in store.windows(worker.windows):
            spans.append((document.start, document.stop))
            cameras.append(document.camera)
            times.extend(document.times)
            positions += len(tracks.points)
            new = np.unique(tracks.track[tracks.track > last_track])  # numbered in their order
            tracks_seen += len(new)
            last_track = max([last_track, *new[-1:].tolist()])
            yield document, tracks

    objects = objects_of(passing())
    size = worker.size
    return ClipDocument(
        inputs=list(clip.paths),
        sha256=clip.sha256,
        start=clip.start,
        step=clip.step,
        width=size[0],
        height=size[1],
        frames=count,
        rate=_rate(times),
        windows=spans,
        cameras=cameras,
        tracks=tracks_seen,
        positions=positions,
        objects=objects,
        history=[
            entry_of(stage, configuration)
            for stage in ("detect", "match", "hypothesize", "cluster")
        ],
    )


def _rate(times: list[float | None]) -> float | None:
    """Frames a second, from the times of the frames."""
    known = [time for time in times if time is not None]
    if len(known) < max(2, len(times)) or known[-1] <= known[0]:
        return None
    return round((len(known) - 1) / (known[-1] - known[0]), 6)
