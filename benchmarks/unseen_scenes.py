"""Random physical scenes: rigid bodies before a pinhole or affine camera, with known motions.

Bodies and camera move by twists that are constant up to jitter. Lengths in pixels are those of a
picture 640 wide and grow with the width; noise and outliers do not.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from benchmarks.unseen_bodies import SHAPES, Body, Flags, angle_of, relief, rotation
from benchmarks.unseen_oracle import achievable, confusions
from benchmarks.unseen_outliers import outlier_tracks
from mssegment.records import Floats, Integers

PICTURES = ((640, 480), (320, 240), (1280, 720), (1920, 1080))
WIDTH = 640.0
"""Width of the picture that lengths in pixels refer to."""
FOCAL = (0.8, 2.5)
"""Focal length over the width of the picture: 64 to 23 degrees of view."""
DEPTH = (4.0, 12.0)
"""Distance of the bodies; the unit of length is arbitrary."""
BACKGROUND = (14.0, 20.0)
"""Distance at which a static scene begins; it ends ``STRETCH`` times as far away."""
STRETCH = (2.0, 5.0)
RADIUS = (40.0, 110.0)
"""Apparent radius of a body, pixels."""
AXIAL = 3.0
"""Largest motion along the optical axis over that across it: 1 % of scale for 3 px."""
JITTER = 0.15
"""Standard deviation of the change of a velocity from frame to frame, over the velocity."""
PAN = 0.3
"""Rotation of a moving camera over that of the bodies."""
SHORTEST = 1 / 3
"""Least share of the frames in which a track is visible."""
CONFUSED = 0.1
"""Largest share of a body's tracks that another body's motion may explain as well."""
TRIES = 300
PACE = 0.03
"""Change of the speeds from one try to the next."""


@dataclass(frozen=True)
class Spec:
    """What a scene is to hold.

    ``sizes`` are the tracks of each body; with ``moving_camera`` the first is the static scene
    with depth that fills the picture. ``speed`` is the mean motion in pixels a frame, ``turn`` the
    largest rotation of a body in degrees a frame, ``roll`` a rotation about the optical axis in
    addition. ``outliers`` tracks are of the kind ``kind`` (``unseen_outliers.KINDS``); ``noise``
    is its standard deviation in pixels. ``visibility`` is ``complete``, ``cut`` (every track has
    a random contiguous third to all of its frames) or ``leaving`` (tracks end where they leave
    the picture).
    """

    frames: int
    sizes: tuple[int, ...]
    outliers: int = 0
    kind: str = "uniform"
    noise: float = 0.5
    affine: bool = False
    moving_camera: bool = False
    speed: float = 3.0
    turn: float = 1.0
    roll: float = 0.0
    visibility: str = "complete"
    picture: tuple[int, int] = (640, 480)
    shapes: tuple[str, ...] = tuple(SHAPES)


@dataclass(frozen=True)
class Scene:
    """Tracks [P, F, 2] in random order (NaN where not visible), true labels and true motions.

    ``exact`` are the tracks without noise, complete; label k is the body ``bodies[k - 1]``.
    ``factors`` say what the scene holds, for tables by factor.
    """

    points: Floats
    labels: Integers
    exact: Floats
    bodies: tuple[Body, ...]
    noise: float
    picture: tuple[int, int]
    factors: dict[str, float | str] = field(default_factory=dict)

    def oracle(self) -> float:
        """The misclassification, a fraction, of one who knows every true motion."""
        return achievable(self.bodies, self.points, self.labels, self.noise)[1]


def generate(spec: Spec, rng: np.random.Generator) -> Scene:
    """A scene as ``spec`` says.

    Bodies are drawn anew, slower, until their points stay in the picture as the visibility wants
    it, and anew, faster, until no two motions are so much alike that their number has no answer
    (``CONFUSED``). Raises RuntimeError where that never happens.
    """
    pace = 1.0
    for _ in range(TRIES):
        bodies = _draw_bodies(spec, rng, pace)
        if bodies is None:
            pace *= 1 - PACE
        elif confusions(bodies, spec.noise).max() > CONFUSED:
            pace *= 1 + PACE
        else:
            return _observed(spec, bodies, rng)
    raise RuntimeError(f"no scene in {TRIES} tries: {spec}")


def cut_tracks(points: Floats, rng: np.random.Generator) -> Floats:
    """The tracks [P, F, 2], each visible in a random contiguous third to all of the frames."""
    tracks, frames = points.shape[:2]
    shortest = max(2, int(np.ceil(SHORTEST * frames)))
    length = rng.integers(shortest, frames + 1, tracks)
    start = rng.integers(0, frames - length + 1)[:, None]
    frame = np.arange(frames)
    visible = (frame >= start) & (frame < start + length[:, None])
    return np.where(visible[..., None], points, np.nan)


def _observed(spec: Spec, bodies: tuple[Body, ...], rng: np.random.Generator) -> Scene:
    """The tracks of the bodies and the outliers, with noise and visibility, in random order."""
    tracks = np.concatenate([body.tracks for body in bodies])
    speed = spec.speed * spec.picture[0] / WIDTH
    wrong = outlier_tracks(spec.kind, spec.outliers, tracks, spec.picture, speed, rng)
    labels = np.repeat([*range(1, len(bodies) + 1), 0], [*spec.sizes, spec.outliers])
    order = rng.permutation(len(labels))
    exact = np.concatenate([tracks, wrong])[order]
    points = exact + rng.normal(0, spec.noise, exact.shape)
    if spec.visibility == "cut":
        points = cut_tracks(points, rng)
    elif spec.visibility == "leaving":
        lasting = _first_runs(_inside(exact, spec.picture)) | (labels[order] == 0)[:, None]
        points = np.where(lasting[..., None], points, np.nan)
    factors: dict[str, float | str] = {
        "motions": len(bodies),
        "outliers": spec.outliers / len(labels),
        "kind of outliers": spec.kind if spec.outliers else "none",
        "noise": spec.noise,
        "tracks": len(labels),
        "frames": spec.frames,
        "turning": max(body.turning for body in bodies),
        "perspective": max(body.perspective for body in bodies),
        "camera": "moving" if spec.moving_camera else "static",
        "visibility": spec.visibility,
    }
    return Scene(
        points,
        labels[order].astype(np.int64),
        exact,
        bodies,
        spec.noise,
        spec.picture,
        factors,
    )


@dataclass(frozen=True)
class _Camera:
    """Focal length in pixels, and the pose in every frame: world to camera coordinates."""

    focal: float
    picture: tuple[int, int]
    turns: Floats
    shifts: Floats

    def see(self, points: Floats, turns: Floats, shifts: Floats, affine: bool) -> Body:
        """The body of ``points`` [n, 3] with these poses [F, 3, 3], [F, 3] in the world."""
        turn = self.turns @ turns
        shift = np.einsum("fij,fj->fi", self.turns, shifts) + self.shifts
        rigid = np.concatenate([turn, shift[..., None]], axis=2)
        centre = np.array(self.picture) / 2
        if affine:
            # scaled orthography: every point is as far away as the origin of the body
            projections = rigid * (self.focal / shift[:, 2])[:, None, None]
            projections[:, :2, 3] += centre
            projections[:, 2] = [0, 0, 0, 1]
        else:
            inner = [[self.focal, 0, centre[0]], [0, self.focal, centre[1]], [0, 0, 1]]
            projections = np.array(inner) @ rigid
        return Body(points, projections, angle_of(turn[-1] @ turn[0].T))


def _draw_bodies(spec: Spec, rng: np.random.Generator, pace: float) -> tuple[Body, ...] | None:
    """All bodies, the static scene first where the camera moves; None where one does not fit.

    ``pace`` multiplies all speeds.
    """
    unit = spec.picture[0] / WIDTH * pace
    camera = _draw_camera(spec, rng, unit, pace)
    bodies: list[Body] = []
    hidden: list[tuple[Floats, float]] = []
    own = spec.sizes[1:] if spec.moving_camera else spec.sizes
    for size, (centre, radius) in zip(own, _places(len(own), spec.picture, rng), strict=True):
        body = _draw_body(spec, rng, camera, (centre, radius, size), (unit, pace))
        if body is None:
            return None
        hidden.append((body.tracks.mean(axis=0), 0.7 * radius))
        bodies.append(body)
    if spec.moving_camera:
        static = _static_scene(spec, rng, camera, hidden)
        if static is None:
            return None
        bodies.insert(0, static)
    return tuple(bodies)


def _draw_camera(spec: Spec, rng: np.random.Generator, unit: float, pace: float) -> _Camera:
    """A camera that stands still, or that moves with constant velocities up to jitter."""
    focal = spec.picture[0] * float(np.exp(rng.uniform(*np.log(FOCAL))))
    turns, shifts = [np.eye(3)], [np.zeros(3)]
    pixel = BACKGROUND[1] * float(np.sqrt(STRETCH[1])) / focal
    velocity, spin = _velocity(rng, spec.speed * unit) * pixel, _spin(rng, PAN * spec.turn * pace)
    for _ in range(spec.frames - 1):
        turn = rotation(_jittered(spin, rng)) if spec.moving_camera else np.eye(3)
        step = _jittered(velocity, rng) if spec.moving_camera else np.zeros(3)
        turns.append(turn @ turns[-1])
        shifts.append(turn @ shifts[-1] + step)
    return _Camera(focal, spec.picture, np.stack(turns), np.stack(shifts))


def _velocity(rng: np.random.Generator, speed: float) -> Floats:
    """A velocity of half to one and a half times ``speed`` pixels across the line of sight."""
    angle = rng.uniform(0, 2 * np.pi)
    heading = np.array([np.cos(angle), np.sin(angle), AXIAL * rng.uniform(-1, 1)])
    return np.asarray(heading * speed * rng.uniform(0.5, 1.5))


def _spin(rng: np.random.Generator, degrees: float) -> Floats:
    """A rotation vector of at most so many degrees about any axis."""
    axis = rng.normal(size=3)
    return np.asarray(axis / np.linalg.norm(axis) * np.deg2rad(degrees) * rng.uniform(0, 1))


def _jittered(velocity: Floats, rng: np.random.Generator) -> Floats:
    size = JITTER * float(np.linalg.norm(velocity)) / np.sqrt(3)
    return np.asarray(velocity + rng.normal(0, size, 3))


def _places(
    count: int, picture: tuple[int, int], rng: np.random.Generator
) -> list[tuple[Floats, float]]:
    """Centres and radii in pixels of bodies that hardly overlap."""
    size, unit = np.array(picture, dtype=float), picture[0] / WIDTH
    largest = RADIUS[1] * min(1.0, float(np.sqrt(3 / max(count, 1))))
    found: list[tuple[Floats, float]] = []
    apart = 1.0
    while len(found) < count:
        radius = rng.uniform(RADIUS[0], largest) * unit
        centre = rng.uniform(0.15 * size, 0.85 * size)
        if all(np.linalg.norm(centre - c) >= apart * (radius + r) for c, r in found):
            found.append((centre, radius))
        # a crowded picture lets bodies come nearer to one another
        apart *= 0.99
    return found


def _draw_body(
    spec: Spec,
    rng: np.random.Generator,
    camera: _Camera,
    place: tuple[Floats, float, int],
    pace: tuple[float, float],
) -> Body | None:
    """A body at (centre, radius, tracks), None where it does not stay in the picture.

    ``pace`` multiplies its speed and its rotation.
    """
    centre, radius, size = place
    far = BACKGROUND[0] * 0.8 if spec.moving_camera else DEPTH[1]
    depth = float(np.exp(rng.uniform(*np.log([DEPTH[0], far]))))
    pixel = depth / camera.focal
    start = np.append((centre - np.array(spec.picture) / 2) * pixel, depth)
    velocity = _velocity(rng, spec.speed * pace[0]) * pixel
    spin = _spin(rng, spec.turn * pace[1])
    roll = rotation(np.array([0, 0, np.deg2rad(spec.roll)]))
    turns, shifts = [np.eye(3)], [start]
    for _ in range(spec.frames - 1):
        turns.append(roll @ rotation(_jittered(spin, rng)) @ turns[-1])
        shifts.append(shifts[-1] + _jittered(velocity, rng))
    shape = SHAPES[spec.shapes[int(rng.integers(len(spec.shapes)))]]
    points = shape(rng, 2 * size + 20, start / np.linalg.norm(start)) * radius * pixel
    body = camera.see(points, np.stack(turns), np.stack(shifts), spec.affine)
    return _visible(body, spec, size)


def _static_scene(
    spec: Spec, rng: np.random.Generator, camera: _Camera, hidden: list[tuple[Floats, float]]
) -> Body | None:
    """A static scene with depth that fills the picture but for what moving bodies hide.

    ``hidden`` are their paths [F, 2] and radii in pixels. None where too little stays visible.
    """
    count = 3 * spec.sizes[0] + 100
    pixels = rng.uniform(0, np.array(spec.picture) - 1.0, (count, 2))
    near, stretch = rng.uniform(*BACKGROUND), rng.uniform(*STRETCH)
    depth = near * stretch ** relief(rng, pixels / np.array(spec.picture))
    rays = (pixels - np.array(spec.picture) / 2) / camera.focal
    points = np.column_stack([rays, np.ones(count)]) * depth[:, None]
    still = np.repeat(np.eye(3)[None], spec.frames, axis=0)
    body = camera.see(points, still, np.zeros((spec.frames, 3)), affine=False)
    covered = np.zeros(count, dtype=bool)
    for path, radius in hidden:
        covered |= (np.linalg.norm(body.tracks - path, axis=-1) < radius).any(axis=1)
    return _visible(Body(points[~covered], body.projections, body.turning), spec, spec.sizes[0])


def _visible(body: Body, spec: Spec, size: int) -> Body | None:
    """The first ``size`` points that the picture shows as the visibility wants it."""
    inside = _inside(body.tracks, spec.picture)
    inside &= body.homogeneous(body.points)[..., 2] > 0
    if spec.visibility == "leaving":
        shown = _first_runs(inside).sum(axis=1) >= max(2, SHORTEST * spec.frames)
    else:
        shown = inside.all(axis=1)
    # a body that is mostly out of the picture is not the one that was asked for
    if shown.sum() < size or shown.mean() < 0.5:
        return None
    return Body(body.points[shown][:size], body.projections, body.turning)


def _inside(tracks: Floats, picture: tuple[int, int]) -> Flags:
    """Where the positions [n, F, 2] are in the picture, [n, F]."""
    return np.asarray(((tracks >= 0) & (tracks <= np.array(picture) - 1)).all(axis=-1))


def _first_runs(inside: Flags) -> Flags:
    """The first run of frames in the picture, [n, F]: a tracker loses what leaves it."""
    begun = np.maximum.accumulate(inside, axis=1)
    ended = np.maximum.accumulate(begun & ~inside, axis=1)
    return np.asarray(begun & ~ended)
