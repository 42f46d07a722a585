"""Every setting of the tool: its type, its default, its range, and one sentence that explains it.

These types are the only place where a setting is defined; the command line, config.yaml, the
environment, `mssegment init` and the table in the README are made from them.

Annotations are evaluated with the classes here, since all of them are looked at on every start;
from strings (``from __future__ import annotations``) that takes several times as long.
"""

from typing import Annotated, Any, Literal, get_args, get_origin

import msgspec
from msgspec import Meta

from mssegment.errors import ConfigurationError, MssegmentError
from mssegment.records import Record

Auto = Literal["auto"]


class Section(msgspec.Struct, frozen=True, kw_only=True):
    """A group of settings."""


class InputSettings(Section, frozen=True):
    """What is read."""

    images: Annotated[list[str], Meta(description="Pictures, a folder, a glob, or a video.")] = []
    tracks: Annotated[
        str | None,
        Meta(description="Tracks of your own instead of pictures (CSV, .mat, tracks document)."),
    ] = None
    start: Annotated[int, Meta(ge=0, description="First frame, counted from 0.")] = 0
    stop: Annotated[
        Annotated[int, Meta(ge=1)] | None, Meta(description="Frame to stop before; none: the end.")
    ] = None
    step: Annotated[int, Meta(ge=1, description="Take every n-th frame.")] = 1


class CameraSettings(Section, frozen=True):
    """The calibrated camera, for models that need one."""

    file: Annotated[
        str | None, Meta(description="YAML or JSON file with fx, fy, cx, cy, distortion.")
    ] = None
    fx: Annotated[
        Annotated[float, Meta(gt=0)] | None, Meta(description="Focal length in x, pixels.")
    ] = None
    fy: Annotated[
        Annotated[float, Meta(gt=0)] | None, Meta(description="Focal length in y, pixels.")
    ] = None
    cx: Annotated[float | None, Meta(description="Principal point, x, pixels.")] = None
    cy: Annotated[float | None, Meta(description="Principal point, y, pixels.")] = None
    distortion: Annotated[
        list[float], Meta(description="Lens distortion k1, k2, p1, p2[, k3, ...] as in OpenCV.")
    ] = []
    derotate: Annotated[
        Auto | bool,
        Meta(description="Take the camera's small rotation out before `translation`."),
    ] = "auto"


class DetectSettings(Section, frozen=True):
    """Harris corners."""

    levels: Annotated[
        Auto | Annotated[int, Meta(ge=1, le=8)],
        Meta(
            description="Scales to look at, a factor sqrt 2 apart; auto: 4 for two views, else 1."
        ),
    ] = "auto"
    max_corners: Annotated[
        Auto | Annotated[int, Meta(ge=1)],
        Meta(description="At most so many corners a frame, on the finest level."),
    ] = "auto"
    quality: Annotated[
        Auto | Annotated[float, Meta(gt=0, lt=1)],
        Meta(description="Least response, as a share of the strongest corner's."),
    ] = "auto"
    min_distance: Annotated[
        Auto | Annotated[float, Meta(ge=0)],
        Meta(description="Least distance between two corners, pixels."),
    ] = "auto"


class MatchSettings(Section, frozen=True):
    """How corners become tracks."""

    method: Annotated[
        Literal["auto", "affine", "patches", "flow"],
        Meta(
            description="affine: oriented patches and affine Lucas-Kanade; patches: plain patch "
            "correlation; flow: pyramidal Lucas-Kanade. auto: affine for two frames, else flow."
        ),
    ] = "auto"
    min_length: Annotated[
        Auto | Annotated[int, Meta(ge=2)],
        Meta(description="Drop tracks that are seen in fewer frames than this."),
    ] = "auto"


class BackgroundSettings(Section, frozen=True):
    """Tracks that stand still under a static camera."""

    remove: Annotated[
        Auto | bool,
        Meta(description="Remove what stands still; auto: when the camera is static."),
    ] = "auto"
    min_displacement: Annotated[
        float, Meta(gt=0, description="A track that moves less, in pixels, stands still.")
    ] = 2.0


class HypothesizeSettings(Section, frozen=True):
    """Motion hypotheses from elemental subsets."""

    model: Annotated[
        Literal["auto", "affine", "homography", "translation", "factorization"],
        Meta(
            description="The motion model; auto: of two views affine or homography, for each "
            "motion the one that says it shorter, of more views factorization."
        ),
    ] = "auto"
    rank: Annotated[
        Auto | Annotated[int, Meta(ge=3, le=4)],
        Meta(description="Rank of a motion's subspace for factorization: 3 planar, 4 general."),
    ] = "auto"
    count: Annotated[
        Auto | Annotated[int, Meta(ge=1, le=1_000_000)],
        Meta(description="Hypotheses to draw; auto: until the outcome settles."),
    ] = "auto"
    sampling: Annotated[
        Literal["local", "uniform"],
        Meta(description="Draw elemental subsets among neighbours, or anywhere."),
    ] = "local"


class ClusterSettings(Section, frozen=True):
    """Mean shift over the manifold."""

    method: Annotated[
        Literal["auto", "meanshift", "consensus"],
        Meta(description="meanshift: the paper; consensus: for long sequences; auto: by frames."),
    ] = "auto"
    bandwidth: Annotated[
        Auto | Annotated[float, Meta(gt=0)],
        Meta(description="Bandwidth h of the kernel; auto: by nearest neighbours."),
    ] = "auto"
    kernel: Annotated[
        Literal["gaussian", "truncated", "epanechnikov"],
        Meta(description="Profile of the kernel; truncated: a Gaussian cut off at 3 h."),
    ] = "gaussian"


class SegmentSettings(Section, frozen=True):
    """From modes to motions."""

    selection: Annotated[
        Literal["mdl", "dominance"],
        Meta(description="mdl: shortest description of all tracks; dominance: the paper's rule."),
    ] = "mdl"
    motions: Annotated[
        Auto | Annotated[int, Meta(ge=0)], Meta(description="Number of motions, where known.")
    ] = "auto"
    min_motions: Annotated[int, Meta(ge=0, description="At least so many motions.")] = 0
    granularity: Annotated[
        Literal["object", "surface", "auto"],
        Meta(
            description="object: parallax is noise, faces of a body are one; surface: each plane "
            "counts."
        ),
    ] = "object"


class ReportSettings(Section, frozen=True):
    """Tables and pictures."""

    labels: Annotated[
        list[str], Meta(description="Manual labels: a CSV of points, or mask pictures.")
    ] = []
    label_radius: Annotated[
        float, Meta(gt=0, description="A labelled point counts for a track within this, pixels.")
    ] = 3.0
    pictures: Annotated[bool, Meta(description="Draw the annotated pictures.")] = True
    picture_format: Annotated[
        Literal["png", "jpg", "svg"], Meta(description="Format of the pictures.")
    ] = "png"
    regions: Annotated[
        bool, Meta(description="Also dense regions per motion, along the edges of the picture.")
    ] = False
    video: Annotated[bool, Meta(description="Also motions.mp4, with trails.")] = False
    html: Annotated[bool, Meta(description="Write report.html.")] = True


class Configuration(Section, frozen=True):
    """All settings; each field of a section is one key, ``cluster.bandwidth`` for example."""

    seed: Annotated[int, Meta(ge=0, description="Seed of every random number.")] = 0
    input: InputSettings = InputSettings()
    camera: CameraSettings = CameraSettings()
    detect: DetectSettings = DetectSettings()
    match: MatchSettings = MatchSettings()
    background: BackgroundSettings = BackgroundSettings()
    hypothesize: HypothesizeSettings = HypothesizeSettings()
    cluster: ClusterSettings = ClusterSettings()
    segment: SegmentSettings = SegmentSettings()
    report: ReportSettings = ReportSettings()


class Key(Record, frozen=True):
    """One setting: its dotted key, its type for msgspec, its default and its sentence."""

    name: str
    type: Any
    default: Any
    description: str

    @property
    def choices(self) -> str:
        """What may be given, for people: ``auto|NUMBER``."""
        return "|".join(_choices(self.type))

    @property
    def expected(self) -> str:
        """The same as a phrase with the range: ``auto|INTEGER (at least 1 and at most 8)``."""
        limits = " and ".join(_limits(self.type))
        return f"{self.choices} ({limits})" if limits else self.choices


def _choices(kind: Any) -> list[str]:
    origin = get_origin(kind)
    if origin is Annotated:
        return _choices(get_args(kind)[0])
    if origin is Literal:
        return [str(value) for value in get_args(kind)]
    if origin is list:
        return [f"{_choices(get_args(kind)[0])[0]}..."]
    if get_args(kind):
        return [word for part in get_args(kind) for word in _choices(part)]
    words = {bool: ["yes", "no"], int: ["INTEGER"], float: ["NUMBER"], str: ["TEXT"]}
    return words.get(kind, ["none"])


def _limits(kind: Any) -> list[str]:
    """The range of the numbers in a type, in words."""
    words = {"gt": "more than", "ge": "at least", "lt": "less than", "le": "at most"}
    own = [
        f"{word} {getattr(meta, name):g}"
        for meta in get_args(kind)[1:]
        if isinstance(meta, Meta)
        for name, word in words.items()
        if getattr(meta, name) is not None
    ]
    parts = get_args(kind) if get_origin(kind) is not Literal else ()
    return [limit for part in parts for limit in _limits(part)] + own


def _keys_of(section: type[Section], prefix: str) -> dict[str, Key]:
    keys: dict[str, Key] = {}
    defaults = section()
    for field, kind in section.__annotations__.items():
        name = prefix + field
        if isinstance(kind, type) and issubclass(kind, Section):
            keys |= _keys_of(kind, f"{name}.")
            continue
        description = next(m.description for m in get_args(kind)[1:] if m.description)
        keys[name] = Key(name, kind, getattr(defaults, field), description)
    return keys


KEYS: dict[str, Key] = _keys_of(Configuration, "")
"""Every setting by its dotted key, in the order of config.yaml."""


class Setting(Record, frozen=True):
    """A value for one key, where it came from, and the error it is when it is wrong."""

    key: str
    value: Any
    origin: str
    error: type[MssegmentError] = ConfigurationError


def check_key(key: str, origin: str) -> None:
    """Raises ConfigurationError, with the nearest key, for one that there is not."""
    if key in KEYS:
        return
    import difflib

    near = difflib.get_close_matches(key, KEYS, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]}?" if near else "`mssegment init` shows all keys"
    raise ConfigurationError(f"{origin}: unknown key {key}; {hint}")
