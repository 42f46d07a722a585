"""What the columns of a table mean, by the names that trackers, spreadsheets and scripts use."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from functools import lru_cache

from mssegment.records import Record


def _names(text: str) -> tuple[str, ...]:
    return tuple(text.split())


TRACK = _names(
    "track track_id track_nr track_no track_number particle particle_id object_id obj_id "
    "trajectory trajectory_id traj traj_id tracklet tracklet_id target_id point_id "
    "keypoint_id feature_id landmark_id marker_id person_id pedestrian_id ped_id vehicle_id "
    "agent_id animal_id tracker_id tracking_id trk_id tid id track_label spot_track_id cell_id "
    "track_n point object obj marker feature label_id"
)
"""Names of the column that identifies a track, the most telling first."""
FRAME = _names(
    "frame frame_id frame_number frame_no frame_nr frame_idx frame_index framenum "
    "frame_nb frame_n fnum image_id image image_name image_file filename file_name file slice "
    "slice_n slice_no slice_number view t time timestamp stamp "
    "time_stamp position_t pos_t"
)
"""Names of the column that identifies a frame: its number, its file, or its time."""
X = _names(
    "x x_px px pos_x position_x x_position x_pos xpos point_x center_x x_center x_centre "
    "centre_x centroid_x x_centroid coord_x x_coord coordinate_x x_coordinate cx xc u col column"
)
Y = _names(
    "y y_px py pos_y position_y y_position y_pos ypos point_y center_y y_center y_centre "
    "centre_y centroid_y y_centroid coord_y y_coord coordinate_y y_coordinate cy yc v row"
)
LEFT = _names("left bb_left bbox_left x_min xmin x0 x1 bbox_x bbox_x1 box_x")
TOP = _names("top bb_top bbox_top y_min ymin y0 y1 bbox_y bbox_y1 box_y")
RIGHT = _names("right bb_right bbox_right x_max xmax x2 x1 bbox_x2")
BOTTOM = _names("bottom bb_bottom bbox_bottom y_max ymax y2 y1 bbox_y2")
WIDTH = _names("width w bb_width bbox_width bbox_w box_w")
HEIGHT = _names("height h bb_height bbox_height bbox_h box_h")
LABEL = _names("label true_label gt_label gt true_motion ground_truth truth class_id")
VISIBLE = _names("visible visibility is_visible visibs vis")
OCCLUDED = _names("occluded occlusion is_occluded occ hidden lost outside")
CONFIDENCE = _names("confidence conf likelihood certainty")

DX = _names("dx delta_x d_x disp_x displacement_x x_displacement flow_x u")
DY = _names("dy delta_y d_y disp_y displacement_y y_displacement flow_y v")

LONGEST = 80
"""Characters of a name that is looked into: the time for that grows with the square."""
_AXES = {"x": "x", "u": "x", "y": "y", "v": "y"}
_ORDERED = [
    pair.split("/")
    for pair in _names(
        "a/b l/r left/right src/dst source/target ref/tgt query/train from/to prev/next old/new "
        "prev/curr previous/current before/after first/second start/end"
    )
]
_AXIS_FIRST = re.compile(r"(?:\w*_)?([xyuv])_?(\d+|[a-z]+|_t\d+)")
_VIEW_FIRST = re.compile(r"(?:[a-z_]*?_?)(\d+|[a-z]+)_?([xyuv])")
_SECOND = ("prime", "new", "next", "2", "dst", "target", "warped", "moved", "proj", "after")
"""Views beside one without a name, as in ``x,y,x_new,y_new`` or ``x,y,x',y'``."""


@lru_cache(maxsize=1024)
def plain(name: str) -> str:
    """A name in lower case with single underscores instead of blanks, units and punctuation."""
    without_unit = re.sub(r"\s*[\[(].*?[\])]", "", name.strip().lower().replace("'", "_prime"))
    return re.sub(r"[^a-z0-9]+", "_", without_unit).strip("_")


def first_of(names: Iterable[str], wanted: Iterable[str]) -> str | None:
    """The first of ``wanted`` that is among ``names``, as it is written there; None if none is."""
    # camelCase is in lower case here, so words are not parted
    known = {plain(name).replace("_", ""): name for name in reversed(list(names))}
    wanted = (name.replace("_", "") for name in wanted)
    return next((known[name] for name in wanted if name in known), None)


def views_of(names: Iterable[str]) -> list[tuple[str, str]]:
    """The pairs of columns (x, y) of each view, as in ``x1,y1,x2,y2`` or ``u0,v0,u1,v1``.

    Parameters
    ----------
    names : iterable of str
        The names of the columns.

    Returns
    -------
    list of (str, str)
        In the order of the views; empty unless there are two views or more.
    """
    found: dict[str, dict[str, str]] = {}
    for name in names:
        place = _view_and_axis(plain(name))
        if place is not None:
            found.setdefault(place[0], {}).setdefault(place[1], name)
    views = {view: axes for view, axes in found.items() if len(axes) == 2}
    views = _with_first(views)
    numbers = sorted((view for view in views if view.isdecimal()), key=int)
    words = [view for view in views if not view.isdecimal()]
    order = (
        numbers if len(numbers) >= 2 else next((p for p in _ORDERED if set(p) <= set(words)), [])
    )
    return [(views[view]["x"], views[view]["y"]) for view in order]


def _with_first(views: dict[str, dict[str, str]]) -> dict[str, dict[str, str]]:
    """The views with one that has no name as the first: ``x,y,x2,y2`` or ``x,y,x_new,y_new``."""
    others = {name: axes for name, axes in views.items() if name}
    if "" not in views or {"0", "1"} & set(others):
        return others
    if len(others) == 1 and next(iter(others)) in _SECOND:
        return {"1": views[""], "2": next(iter(others.values()))}
    return {"1": views[""], **others} if "2" in others else others


def _view_and_axis(name: str) -> tuple[str, str] | None:
    if len(name) > LONGEST:
        return None
    if name in _AXES:
        return "", _AXES[name]
    if match := _AXIS_FIRST.fullmatch(name):
        return match[2].removeprefix("_t"), _AXES[match[1]]
    if match := _VIEW_FIRST.fullmatch(name):
        return match[1], _AXES[match[2]]
    return None


def displacement_of(names: Iterable[str]) -> tuple[str, str, str, str] | None:
    """The columns x, y and dx, dy of places and how they move; None where one is missing.

    Also None where there are frames: a field for each of several is no pair of views.
    """
    known = list(names)
    if first_of(known, FRAME) is not None:
        return None
    dx, dy = first_of(known, DX), first_of(known, DY)
    rest = [name for name in known if name not in (dx, dy)]
    x, y = first_of(rest, X), first_of(rest, Y)
    if x is None or y is None or dx is None or dy is None:
        return None
    return x, y, dx, dy


def _of_boxes(names: Iterable[str], wanted: Sequence[str]) -> set[str]:
    """The names that are sides of a box and nothing else; beside it x, y may be of the world."""
    return {name for name in names if plain(name) in wanted and not re.search(r"\d", name)}


class Sightings(Record, frozen=True):
    """The columns of a table with one position of a track per row.

    Attributes
    ----------
    track, frame : str
        The columns that identify the track and the frame.
    x, y : tuple of str
        One column each, or two whose mean is the position: the sides of a box. A second column
        that begins with ``+`` is the extent of the box.
    """

    track: str
    frame: str
    x: tuple[str, ...]
    y: tuple[str, ...]

    @property
    def used(self) -> set[str]:
        """All columns that are used."""
        return {self.track, self.frame, *(name.lstrip("+") for name in (*self.x, *self.y))}


def sightings_of(names: Iterable[str]) -> Sightings | None:
    """The columns of track, frame and position, or None if one of them is missing."""
    known = list(names)
    frame = first_of(known, FRAME)
    track = first_of([name for name in known if name != frame], TRACK)
    if track is None or frame is None:
        return None
    rest = [name for name in known if name not in (track, frame)]
    x, y = first_of(rest, X), first_of(rest, Y)
    left, top = first_of(rest, LEFT), first_of(rest, TOP)
    width, height = first_of(rest, WIDTH), first_of(rest, HEIGHT)
    right = first_of([n for n in rest if n != left], RIGHT)
    bottom = first_of([n for n in rest if n != top], BOTTOM)
    has_box = left in _of_boxes(rest, LEFT) and top in _of_boxes(rest, TOP)
    has_box = has_box and width is not None and height is not None
    if x is not None and y is not None and not has_box:
        return Sightings(track, frame, (x,), (y,))
    if left is None or top is None:
        return None
    if width is not None and height is not None:
        return Sightings(track, frame, (left, f"+{width}"), (top, f"+{height}"))
    if right is not None and bottom is not None:
        return Sightings(track, frame, (left, right), (top, bottom))
    return None
