"""Masks against exact ones: ``python -m benchmarks.masks [SCENES]``.

J and F of DAVIS on the sample scenes, and on random scenes that nothing was chosen on: two objects
with random outlines, textures and affine motions before a wall that moves with the camera; the
textures are drawn alike, so that colours do not tell the objects apart, or in colours of their own.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

import mssegment
from mssegment.datasets import labels_from_masks
from mssegment.masks import label_pixels
from mssegment.masks.quality import MaskQuality, mask_quality

SAMPLES = Path(__file__).parents[1] / "sample_data"
WIDTH, HEIGHT = 480, 360
Picture = np.ndarray
Case = tuple[list[Picture], dict[int, Picture]]
"""The frames, and true masks by frame."""


def sample_scene(name: str) -> Case:
    """The frames and masks of a sample scene."""
    folder = SAMPLES / name
    count = len(list(folder.glob("frame-*.png")))
    frames = [cv2.imread(str(folder / f"frame-{i + 1}.png")) for i in range(count)]
    masks = {
        i: cv2.imread(str(folder / f"mask-{i + 1}.png"), cv2.IMREAD_UNCHANGED).astype(np.int64)
        for i in range(count)
    }
    return frames, masks


def random_scene(seed: int, frames: int, alike: bool) -> Case:
    """A random scene; the rim of each object, two pixels wide, is not judged."""
    rng = np.random.default_rng([seed, frames, alike])
    grain = rng.uniform(1.2, 2.5)
    layers = [_texture(rng, grain if alike else rng.uniform(1.2, 2.5), alike) for _ in range(3)]
    outlines = [_outline(rng, middle) for middle in ((140, 180), (330, 180))]
    steps = [_step(rng, 4.0) for _ in range(3)]
    pictures, masks = [], {}
    maps = [np.eye(3) for _ in range(3)]
    for index in range(frames):
        picture = _warped(layers[0], maps[0])
        mask = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
        for label in (1, 2):
            shape = np.zeros((HEIGHT, WIDTH), dtype=np.uint8)
            cv2.fillPoly(shape, [outlines[label - 1]], 255)
            own = _warped(shape, maps[label]) > 127
            picture[own] = _warped(layers[label], maps[label])[own]
            mask[own] = label
        pictures.append(picture)
        edge = cv2.morphologyEx(mask, cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
        masks[index] = np.where(edge, 255, mask).astype(np.int64)
        maps = [step @ before for step, before in zip(steps, maps, strict=True)]
    return pictures, masks


def _texture(rng: np.random.Generator, grain: float, alike: bool) -> Picture:
    """Blurred noise with the contrast of photographs; in grey, or around a colour of its own."""
    noise = cv2.GaussianBlur(rng.normal(size=(HEIGHT, WIDTH)), (0, 0), grain)
    noise = noise / noise.std() * 30
    colour = np.full(3, 128.0) if alike else rng.uniform(70, 190, 3)
    return np.clip(noise[..., None] + colour, 0, 255).astype(np.uint8)


def _outline(rng: np.random.Generator, middle: tuple[int, int]) -> Picture:
    """A closed outline of 7 corners at random distances."""
    angles = np.arange(7) * 2 * np.pi / 7 + rng.uniform(-0.3, 0.3, 7)
    radii = rng.uniform(50, 85, 7)
    corners = np.array(middle) + radii[:, None] * np.stack([np.cos(angles), np.sin(angles)], 1)
    return np.asarray(np.round(corners), dtype=np.int32)


def _step(rng: np.random.Generator, speed: float) -> Picture:
    """An affine map close to the identity, about the middle of the picture."""
    middle = np.array([WIDTH / 2, HEIGHT / 2])
    linear = np.eye(2) + rng.uniform(-0.015, 0.015, (2, 2))
    angle = rng.uniform(0, 2 * np.pi)
    shift = speed * rng.uniform(0.7, 1.5) * np.array([np.cos(angle), np.sin(angle)])
    matrix = np.eye(3)
    matrix[:2, :2], matrix[:2, 2] = linear, middle - linear @ middle + shift
    return matrix


def _warped(picture: Picture, matrix: Picture) -> Picture:
    size = (WIDTH, HEIGHT)
    return cv2.warpAffine(picture, matrix[:2], size, borderMode=cv2.BORDER_REFLECT)


Qualities = tuple[list[MaskQuality], list[MaskQuality]]
"""J and F of every object: of the whole program, and with the true labels of the tracks."""


def measured(case: Case) -> Qualities:
    """The quality of the masks of a scene."""
    pictures, truth = case
    found = mssegment.segment_pictures(pictures, channels="bgr")
    whole = mask_quality(dict(enumerate(found.masks())), truth)
    labels = labels_from_masks(found.points, truth)
    world = int(labels.max(initial=0)) + 1
    given = label_pixels(
        found.points,
        np.where(labels == 0, world, labels),
        found.tracks.frames,
        pictures.__getitem__,
        camera_motion=world,
    )
    return list(whole), list(mask_quality(dict(enumerate(given)), truth))


def rows(scenes: int) -> Iterator[tuple[str, Qualities]]:
    """The name and the objects of each group of scenes."""
    for name in ("affine", "translation", "factorization"):
        yield f"sample scene {name}", measured(sample_scene(name))
    for frames in (2, 5):
        for alike in (False, True):
            cases = [measured(random_scene(seed, frames, alike)) for seed in range(scenes)]
            kind = "textures alike" if alike else "own colours"
            objects = [one for whole, _ in cases for one in whole]
            given = [one for _, own in cases for one in own]
            yield f"{scenes} random scenes, {frames} frames, {kind}", (objects, given)


def _figures(objects: list[MaskQuality]) -> str:
    region = np.array([one.region for one in objects])
    contour = np.array([one.contour for one in objects])
    enough = 100 * np.mean(region >= 0.95)
    return f"{region.mean():.3f} | {region.min():.3f} | {contour.mean():.3f} | {enough:.0f} %"


def main() -> None:
    """Print a table in Markdown."""
    scenes = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    figures = "J mean | J least | F mean | J at least 0.95"
    print(f"| scenes | objects | {figures} | true tracks: {figures} |")
    print("|---" * 10 + "|")
    for name, (whole, given) in rows(scenes):
        print(f"| {name} | {len(whole)} | {_figures(whole)} | {_figures(given)} |", flush=True)


if __name__ == "__main__":
    main()
