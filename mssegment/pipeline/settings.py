"""What the stages make of the configuration: random streams, options, the camera."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from mssegment.configuration import Configuration, camera_of
from mssegment.documents.checks import check_camera
from mssegment.errors import ConfigurationError
from mssegment.records import Camera, Floats, Frame, Strategy

if TYPE_CHECKING:
    from mssegment.sampling.options import SamplingOptions
    from mssegment.segmentation.options import SegmentOptions

_STREAMS = {"hypothesize": 2, "cluster": 3}


def random_stream(stage: str, configuration: Configuration) -> np.random.Generator:
    """The random numbers of a stage, the same whether it runs alone or after the others."""
    return np.random.default_rng([configuration.seed, _STREAMS[stage]])


def check_settings(configuration: Configuration, frames: int, threads: int = 1) -> None:
    """Raise an error for a setting that the strategy for this number of frames does not use."""
    from mssegment.sampling.strategy import check_sampling
    from mssegment.segmentation.options import check_options

    options, strategy = sampling_of(configuration, frames)
    check_sampling(options, strategy, frames)
    check_options(segment_options_of(configuration, threads), strategy)


def sampling_of(configuration: Configuration, frames: int) -> tuple[SamplingOptions, Strategy]:
    """Sampling options, and the strategy, for tracks over this number of frames."""
    from mssegment.sampling.options import SamplingOptions
    from mssegment.sampling.strategy import choose_strategy

    settings = configuration.hypothesize
    options = SamplingOptions(
        settings.model,
        settings.rank,
        settings.count,
        settings.sampling,
        configuration.camera.derotate,
    )
    method, selection = configuration.cluster.method, configuration.segment.selection
    return options, choose_strategy(method, selection, options.models(frames), frames)


def segment_options_of(configuration: Configuration, threads: int) -> SegmentOptions:
    """The options of ``cluster`` from the configuration."""
    from mssegment.segmentation.options import SegmentOptions

    shift, settings = configuration.cluster, configuration.segment
    return SegmentOptions(
        bandwidth=shift.bandwidth,
        kernel=shift.kernel,
        selection=settings.selection,
        motions=unless_auto(settings.motions),
        min_motions=settings.min_motions,
        granularity=settings.granularity,
        threads=threads,
    )


def camera_for(
    frames: list[Frame],
    configuration: Configuration,
    earlier: Camera | None = None,
    *,
    are_pictures: bool = True,
) -> tuple[Camera | None, tuple[str, ...]]:
    """The camera of the configuration, checked against the frames, and notes on it.

    Parameters
    ----------
    frames : list of Frame
        The frames.
    configuration : Configuration
        Its camera has precedence.
    earlier : Camera, optional
        The camera of an earlier stage or of an imported file.
    are_pictures : bool
        Whether the size of the frames is that of pictures, and not only what holds the tracks.

    Returns
    -------
    camera : Camera or None
    notes : tuple of str

    Raises
    ------
    ConfigurationError
        If the camera file cannot be read, or the camera cannot be that of the frames.
    """
    from mssegment.models import MODELS

    camera = camera_of(configuration.camera)
    if camera is None:
        return earlier, ()
    try:
        check_camera(camera)
    except ValueError as error:
        raise ConfigurationError(str(error)) from None
    notes: tuple[str, ...] = ()
    if frames and are_pictures:
        from mssegment.cameras import fitted

        camera, notes = fitted(camera, *frame_size(frames))
    elif frames and frames[0].width:
        from mssegment.cameras import notes_on_tracks

        notes = notes_on_tracks(camera, *frame_size(frames))
    names = sampling_of(configuration, len(frames))[0].models(len(frames), calibrated=True)
    if not any(camera.distortion) and not any(MODELS[name].needs_camera for name in names):
        own = " and ".join(dict.fromkeys(names))
        needing = " or ".join(name for name, model in MODELS.items() if model.needs_camera)
        notes += (f"the camera is not used: {own} needs none; model {needing} does",)
    return camera, notes


def straight(points: Floats, camera: Camera | None) -> Floats:
    """Remove lens distortion from points, if the camera has any."""
    if camera is None or not camera.distortion:
        return points
    from mssegment.imaging.camera import undistort_points

    return undistort_points(points, camera)


def frame_size(frames: list[Frame]) -> tuple[int, int]:
    """Width and height of the first frame in pixels, 0 without frames."""
    return (frames[0].width, frames[0].height) if frames else (0, 0)


def unless_auto(value: Any) -> Any:
    """The value of a setting, None where it is to be chosen."""
    return None if value == "auto" else value
