"""A long clip from its frames, or the file of its tracks, to the files of its windows.

Three things happen at the same time: one thread decodes frames and detects their corners, this one
follows the tracks, and another one has the windows that are full segmented, in a process of its own
or by itself, and writes their files. Of a file of tracks only the last remains.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from contextlib import closing
from pathlib import Path

from mssegment.clips.choice import limits_of
from mssegment.clips.pixels import windows_of_pixels
from mssegment.clips.segmenter import Segmenter
from mssegment.clips.store import CLIP, ClipState, ClipStore, read_clip
from mssegment.clips.summary import summary
from mssegment.clips.track_clip import TrackClip, windows_of_tracks
from mssegment.clips.windows import FullWindow
from mssegment.clips.worker import Worker
from mssegment.configuration import Configuration
from mssegment.documents.clips import ClipDocument, WindowDocument
from mssegment.imaging.streams import Clip
from mssegment.imaging.threads import threads_beside


def process(
    clip: Clip | TrackClip,
    configuration: Configuration,
    folder: Path,
    on_window: Callable[[WindowDocument], None] = lambda window: None,
    segmenter: Segmenter | None = None,
) -> ClipDocument:
    """Segment a clip window by window.

    Parameters
    ----------
    clip : Clip or TrackClip
        The frames, or the tracks.
    configuration : Configuration
        The settings.
    folder : Path
        Where the files go. If it holds the state of the same clip, interrupted, that is continued.
    on_window : callable
        Called with the document of each window when its files are written.
    segmenter : Segmenter, optional
        Who segments the windows; by default the thread that writes their files.

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
    if (folder / CLIP).exists():  # interrupted after the last window
        return read_clip(str(folder))[0]
    state = store.read_state()
    if state is None or not state.is_last:
        state = _segment(clip, configuration, store, state, on_window, segmenter or Segmenter())
    document = summary(clip, configuration, store, state)
    store.write_clip(document)
    return document


def _segment(
    clip: Clip | TrackClip,
    configuration: Configuration,
    store: ClipStore,
    resumed: ClipState | None,
    on_window: Callable[[WindowDocument], None],
    segmenter: Segmenter,
) -> ClipState:
    """Segment the windows that are left; the state after the last one."""
    with threads_beside(2), closing(_windows(clip, configuration, resumed)) as windows:
        worker = Worker(clip, store, configuration, resumed, on_window, segmenter)
        try:
            for window in windows:
                worker.put(window)
            return worker.finish()
        except BaseException:
            worker.stop()
            raise
        finally:
            segmenter.stop()


def _windows(
    clip: Clip | TrackClip, configuration: Configuration, resumed: ClipState | None
) -> Generator[FullWindow]:
    if isinstance(clip, TrackClip):
        return windows_of_tracks(clip, limits_of(configuration), resumed)
    return windows_of_pixels(clip, configuration, resumed)
