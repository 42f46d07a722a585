"""Full windows become files: a thread segments them in their order."""

from __future__ import annotations

import contextvars
import queue
import threading
from collections.abc import Callable, Sequence

import numpy as np

from mssegment.clips.segment import SegmentedWindow
from mssegment.clips.segmenter import Segmenter, Task
from mssegment.clips.store import ClipState, ClipStore, LiveTracks
from mssegment.clips.track_clip import TrackClip
from mssegment.clips.windows import FullWindow
from mssegment.configuration import Configuration
from mssegment.documents.clips import WindowDocument, WindowMotion, WindowTracks
from mssegment.history import entry_of
from mssegment.imaging.streams import Clip
from mssegment.imaging.tracking import FramePoints
from mssegment.progress import listening
from mssegment.records import BACKGROUND, Floats, Motion, replace
from mssegment.sequences.history import STATIC_WORLD
from mssegment.sequences.identities import IdentityTracker
from mssegment.sequences.window_labels import WindowIdentities, WindowLabels

WAITING_WINDOWS = 2
"""Windows that wait to be segmented; with more, tracking waits."""


class Worker:
    """Has windows segmented in their order, in a thread, and writes their files."""

    def __init__(
        self,
        clip: Clip | TrackClip,
        store: ClipStore,
        configuration: Configuration,
        resumed: ClipState | None,
        on_window: Callable[[WindowDocument], None],
        segmenter: Segmenter,
    ) -> None:
        self._store, self._configuration, self._on_window = store, configuration, on_window
        self._segmenter = segmenter
        segmenter.start()
        self._camera = clip.camera if isinstance(clip, TrackClip) else None
        self._history = (
            clip.history if isinstance(clip, TrackClip) else (entry_of("detect", configuration),)
        )
        self._state = resumed
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

    def finish(self) -> ClipState:
        """Wait for all windows; the state after the last one."""
        while self._thread.is_alive():
            try:
                self._waiting.put(None, timeout=0.1)
                break
            except queue.Full:
                continue
        self._thread.join()
        if self._error is not None:
            raise self._error
        assert self._state is not None
        return self._state

    def stop(self) -> None:
        """End; a window that a process of its own segments is not waited for."""
        self._stopped.set()
        self._segmenter.stop()
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
        found = self._segmenter.segment(
            Task(
                window.points,
                window.frames,
                self._configuration,
                earlier_background=earlier_background,
                moved_before=seen_before & ~earlier_background,
                camera=self._camera,
                history=self._history,
            )
        )
        found = _separated(window, found, self._identities)
        joined = self._identities.add(_labels(window, found), window.paused)
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
        self._state = self._after(window)
        self._store.write_state(self._state)
        self._on_window(document)

    def _after(self, window: FullWindow) -> ClipState:
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
            is_last=window.is_last,
        )


def _stored(points: Sequence[FramePoints]) -> list[LiveTracks]:
    return [LiveTracks(own.tracks, own.points.astype(np.float64)) for own in points]


def _labels(window: FullWindow, found: SegmentedWindow) -> WindowLabels:
    """What identities are made of: tracks while they move with their motion."""
    points = np.where(found.shown[..., None], window.points, np.nan)
    return WindowLabels(
        window.start, window.tracks, points, found.labels, found.camera_motion, found.stuck
    )


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
