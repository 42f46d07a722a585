"""Every setting of the tool: its type, default, range, and a one-sentence description.

These types are the single definition of the settings. The options of the command line, the keys
of config.yaml, the environment variables, the output of `mssegment init` and the table in the
README are all generated from them.

This module does not use ``from __future__ import annotations``: the annotations are read at every
start, and evaluating them from strings takes several times as long.
"""

from typing import TYPE_CHECKING, Annotated, Any, Literal, get_args, get_origin

import msgspec
from msgspec import Meta

from mssegment.errors import ConfigurationError, MssegmentError
from mssegment.imaging.matching import MATCHERS, default_matcher
from mssegment.inputs.limits import LIMITS
from mssegment.records import Record
from mssegment.registry import EXPORTS, KERNELS, MASK_STYLES, MODELS, SELECTIONS

Auto = Literal["auto"]

if TYPE_CHECKING:
    ModelName = str
    MatcherName = str
    KernelName = str
    SelectionName = str
    ExportName = str
    MaskStyleName = str
else:
    ModelName = Literal["auto", *MODELS]
    MatcherName = Literal["auto", *MATCHERS]
    KernelName = Literal[*KERNELS]
    SelectionName = Literal[*SELECTIONS]
    ExportName = Literal[*EXPORTS]
    MaskStyleName = Literal[*MASK_STYLES]


class Section(msgspec.Struct, frozen=True, kw_only=True):
    """A group of settings."""


class InputSettings(Section, frozen=True):
    """The input: images or tracks."""

    images: Annotated[
        list[str],
        Meta(
            description="Image files, a folder, a pattern, or a video; with tracks, the images "
            "that they were made from."
        ),
    ] = []
    tracks: Annotated[
        str | None,
        Meta(
            description="Tracks of another program, or a tracks document; FILE#PART names a part."
        ),
    ] = None
    start: Annotated[int, Meta(ge=0, description="Index of the first frame, counted from 0.")] = 0
    stop: Annotated[
        Annotated[int, Meta(ge=1)] | None,
        Meta(description="Index of the frame to stop before; none: read to the end."),
    ] = None
    step: Annotated[int, Meta(ge=1, description="Read every n-th frame.")] = 1


class CameraSettings(Section, frozen=True):
    """The calibrated camera, for models that need one."""

    file: Annotated[
        str | None,
        Meta(
            description="Camera file: fx, fy, cx, cy, distortion in YAML or JSON, or the file of a "
            "calibration program; FILE#NAME chooses one of several cameras."
        ),
    ] = None
    fx: Annotated[
        Annotated[float, Meta(gt=0)] | None, Meta(description="Horizontal focal length, in pixels.")
    ] = None
    fy: Annotated[
        Annotated[float, Meta(gt=0)] | None, Meta(description="Vertical focal length, in pixels.")
    ] = None
    cx: Annotated[float | None, Meta(description="Principal point x, in pixels.")] = None
    cy: Annotated[float | None, Meta(description="Principal point y, in pixels.")] = None
    distortion: Annotated[
        list[float],
        Meta(description="Lens distortion coefficients k1, k2, p1, p2[, k3, ...] as in OpenCV."),
    ] = []
    distortion_model: Annotated[
        Literal["brown", "fisheye"],
        Meta(
            description="Model of the distortion; fisheye: the equidistant projection, with "
            "coefficients k1, k2, k3, k4."
        ),
    ] = "brown"
    derotate: Annotated[
        Auto | bool,
        Meta(
            description="Compensate a small camera rotation for model translation; auto: where it "
            "explains the matches much better."
        ),
    ] = "auto"


class DetectSettings(Section, frozen=True):
    """Harris corner detection."""

    levels: Annotated[
        Auto | Annotated[int, Meta(ge=1, le=8)],
        Meta(
            description="Number of pyramid levels, a factor of sqrt(2) apart; auto: 4 or more for "
            "two views, otherwise 1."
        ),
    ] = "auto"
    max_corners: Annotated[
        Auto | Annotated[int, Meta(ge=1)],
        Meta(
            description="Maximum number of corners per frame on the finest level; auto: 1500 for "
            "two views, otherwise 1000."
        ),
    ] = "auto"
    quality: Annotated[
        Auto | Annotated[float, Meta(gt=0, lt=1)],
        Meta(
            description="Minimum Harris response, as a fraction of the strongest one; auto: 0.0001."
        ),
    ] = "auto"
    min_distance: Annotated[
        Auto | Annotated[float, Meta(ge=0)],
        Meta(
            description="Minimum distance between corners, in pixels; auto: 0 for two views, "
            "otherwise 5."
        ),
    ] = "auto"


class MatchSettings(Section, frozen=True):
    """Matching and tracking of corners."""

    method: Annotated[
        MatcherName,
        Meta(
            description="; ".join(f"{m.name}: {m.description}" for m in MATCHERS.values())
            + f"; auto: {default_matcher(2)} for two frames, otherwise {default_matcher(3)}."
        ),
    ] = "auto"
    min_length: Annotated[
        Auto | Annotated[int, Meta(ge=2)],
        Meta(
            description="Minimum track length in frames, for method flow; auto: the whole sequence "
            "for up to 8 frames, otherwise 3."
        ),
    ] = "auto"


class BackgroundSettings(Section, frozen=True):
    """Static tracks under a static camera."""

    remove: Annotated[
        Auto | bool,
        Meta(description="Remove static tracks as background; auto: when the camera is static."),
    ] = "auto"
    min_displacement: Annotated[
        Auto | Annotated[float, Meta(gt=0)],
        Meta(
            description="Tracks that move less than this, in pixels, are static; auto: 2, or more "
            "where the noise of two views is larger."
        ),
    ] = "auto"


class HypothesizeSettings(Section, frozen=True):
    """Motion hypotheses from elemental subsets."""

    model: Annotated[
        ModelName,
        Meta(
            description="Motion model, or the structures of data that is no picture; auto: for two "
            "views affine, homography or, with a camera, essential, whichever describes the motion "
            "with the shorter code; for "
            "more views factorization."
        ),
    ] = "auto"
    rank: Annotated[
        Auto | Annotated[int, Meta(ge=1)],
        Meta(
            description="Rank of a motion's subspace for model factorization: 3 for planar or "
            "translating objects, 4 in general; auto: both, but 3 for method meanshift over fewer "
            "than 6 frames. For model subspace, the dimension of the subspaces."
        ),
    ] = "auto"
    count: Annotated[
        Auto | Annotated[int, Meta(ge=1, le=1_000_000)],
        Meta(
            description="Number of hypotheses to draw; auto: until further ones no longer improve "
            "the fit of the tracks."
        ),
    ] = "auto"
    sampling: Annotated[
        Literal["local", "uniform"],
        Meta(
            description="local: draw elemental subsets among neighbouring tracks; uniform: among "
            "all tracks."
        ),
    ] = "local"


class ClusterSettings(Section, frozen=True):
    """Mean shift over the manifold."""

    method: Annotated[
        Literal["auto", "meanshift", "consensus"],
        Meta(
            description="meanshift: motions from the modes, as in the paper; consensus: consensus "
            "clustering of the tracks; auto: consensus for factorization over 3 frames or more, "
            "otherwise meanshift."
        ),
    ] = "auto"
    bandwidth: Annotated[
        Auto | Annotated[float, Meta(gt=0)],
        Meta(description="Bandwidth h of the kernel; auto: from nearest-neighbour distances."),
    ] = "auto"
    kernel: Annotated[
        KernelName,
        Meta(description="Kernel profile; truncated: a Gaussian that reaches zero at 3 h."),
    ] = "gaussian"


class SegmentSettings(Section, frozen=True):
    """From modes to motions."""

    selection: Annotated[
        SelectionName,
        Meta(
            description="Rule that selects the motions; mdl: minimum description length; "
            "dominance: the most dominant modes, as in the paper."
        ),
    ] = "mdl"
    motions: Annotated[
        Auto | Annotated[int, Meta(ge=0)],
        Meta(description="Number of motions, if known; auto: estimated."),
    ] = "auto"
    min_motions: Annotated[int, Meta(ge=0, description="Minimum number of motions.")] = 0
    granularity: Annotated[
        Literal["object", "surface", "auto", "none"],
        Meta(
            description="object: each rigid body is a motion, and the planes of one are joined, "
            "such as those of a static scene; surface: each plane is a motion of its own; auto: "
            "surface if the planes found are flat, otherwise object; none: as object, but nothing "
            "is joined."
        ),
    ] = "object"
    camera_motion: Annotated[
        bool,
        Meta(
            description="Under a moving camera, call the motion of the static world `camera`: that "
            "of the tracks that are spread over the picture."
        ),
    ] = True


class SequenceSettings(Section, frozen=True):
    """Windows of long sequences."""

    window: Annotated[
        Literal["auto", "none"] | Annotated[int, Meta(ge=3)],
        Meta(
            description="Frames of a window of a long sequence, each of which is segmented on its "
            "own; auto: as long as its tracks last, and one window for at most 100 frames; none: "
            "one window, whatever the length."
        ),
    ] = "auto"
    overlap: Annotated[
        Auto | Annotated[int, Meta(ge=1)],
        Meta(
            description="Frames that neighbouring windows share, at most half of a window; auto: "
            "until half of the tracks have ended."
        ),
    ] = "auto"


class ReportSettings(Section, frozen=True):
    """Tables, pictures and the HTML report."""

    labels: Annotated[
        list[str],
        Meta(
            description="Ground-truth labels: a table of points, mask images or their folder, "
            "or files of labelme, COCO, CVAT, VIA, VOC, YOLO or MOTS."
        ),
    ] = []
    label_radius: Annotated[
        float,
        Meta(gt=0, description="Maximum distance from a labelled point to its track, in pixels."),
    ] = 3.0
    background_label: Annotated[
        Literal["auto", "none", "motion"],
        Meta(
            description="What the true label 0 is; none: outliers; motion: the static world, "
            "matched like an object; auto: the static world, where most tracks with label 0 were "
            "found to be the background or the camera's motion, otherwise outliers."
        ),
    ] = "auto"
    pictures: Annotated[bool, Meta(description="Write annotated pictures.")] = True
    picture_format: Annotated[
        Literal["png", "jpg", "svg"], Meta(description="File format of the pictures.")
    ] = "png"
    masks: Annotated[
        bool,
        Meta(
            description="Also write a mask of every frame: 0 the static world, 1, 2, ... the "
            "motions, 255 not known."
        ),
    ] = False
    mask_style: Annotated[
        MaskStyleName,
        Meta(
            description="davis: indexed PNG; colmap: PNG with 0 on moving objects, for COLMAP and "
            "hloc; binary: a PNG per object; coco: one JSON with run lengths."
        ),
    ] = "davis"
    export: Annotated[
        list[ExportName],
        Meta(
            description="Also write trajectories: tracks.csv, objects.csv, mot.txt (MOTChallenge) "
            "or tracks.npz; of data that is no picture, points.csv."
        ),
    ] = []
    regions: Annotated[
        bool,
        Meta(description="Also write dense regions per motion, aligned with image edges."),
    ] = False
    video: Annotated[
        bool, Meta(description="Also write motions.mp4, with trails behind the tracks.")
    ] = False
    html: Annotated[bool, Meta(description="Write report.html.")] = True


if TYPE_CHECKING:

    class LimitSettings(Section, frozen=True):
        """Sizes of input that are refused, one field for each of ``inputs.limits.LIMITS``."""

else:
    LimitSettings = msgspec.defstruct(
        "LimitSettings",
        [
            (name, Annotated[int, Meta(ge=1, description=own.description)], own.default)
            for name, own in LIMITS.items()
        ],
        bases=(Section,),
        frozen=True,
        kw_only=True,
    )
    LimitSettings.__doc__ = "Sizes of input above which it is refused."


class Configuration(Section, frozen=True):
    """All settings. Each field of a section is one key, for example ``cluster.bandwidth``."""

    seed: Annotated[int, Meta(ge=0, description="Seed of the random number generators.")] = 0
    input: InputSettings = InputSettings()
    camera: CameraSettings = CameraSettings()
    detect: DetectSettings = DetectSettings()
    match: MatchSettings = MatchSettings()
    background: BackgroundSettings = BackgroundSettings()
    hypothesize: HypothesizeSettings = HypothesizeSettings()
    cluster: ClusterSettings = ClusterSettings()
    segment: SegmentSettings = SegmentSettings()
    sequence: SequenceSettings = SequenceSettings()
    report: ReportSettings = ReportSettings()
    limits: LimitSettings = LimitSettings()


class Key(Record, frozen=True):
    """One setting: its dotted key, its type for msgspec, its default and its description."""

    name: str
    type: Any
    default: Any
    description: str

    @property
    def choices(self) -> str:
        """The accepted values, for help texts: ``auto|NUMBER``."""
        return "|".join(_choices(self.type))

    @property
    def expected(self) -> str:
        """The accepted values and their range: ``auto|INTEGER (at least 1 and at most 8)``."""
        limits = " and ".join(_limits(self.type))
        return f"{self.choices} ({limits})" if limits else self.choices


def _choices(kind: Any) -> list[str]:
    origin = get_origin(kind)
    if origin is Annotated:
        return _choices(get_args(kind)[0])
    if origin is Literal:
        return [str(value) for value in get_args(kind)]
    if origin is list:
        return [f"{'|'.join(_choices(get_args(kind)[0]))}..."]
    if get_args(kind):
        return [word for part in get_args(kind) for word in _choices(part)]
    words = {bool: ["yes", "no"], int: ["INTEGER"], float: ["NUMBER"], str: ["TEXT"]}
    return words.get(kind, ["none"])


def _limits(kind: Any) -> list[str]:
    """The range of the numbers in a type, as phrases."""
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
"""Every setting by its dotted key, in the order in which config.yaml lists them."""


class Setting(Record, frozen=True):
    """A value for one key, its origin, and the error to raise if the value is not valid.

    ``origin`` opens the error message: a file with line and column, a flag, or a variable.
    """

    key: str
    value: Any
    origin: str
    error: type[MssegmentError] = ConfigurationError


def check_key(key: str, origin: str) -> None:
    """Raises ConfigurationError for an unknown key and suggests the nearest known one."""
    if key in KEYS:
        return
    import difflib

    near = difflib.get_close_matches(key, KEYS, n=1, cutoff=0.5)
    hint = f"did you mean {near[0]}?" if near else "`mssegment init` shows all keys"
    raise ConfigurationError(f"{origin}: unknown key {key}; {hint}")
