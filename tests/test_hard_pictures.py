"""What is burnt into a picture, or broken in a camera, does not hide the scene."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
import pytest

from mssegment.imaging.corners import detect

Grey = npt.NDArray[np.float32]


def fog(seed: int) -> Grey:
    """Texture of two grey levels around 118."""
    noise = np.random.default_rng(seed).normal(0, 1, (240, 320)).astype(np.float32)
    smooth = np.asarray(cv2.GaussianBlur(noise, (0, 0), 2.0))
    return np.asarray(118 + 2 * smooth / smooth.std(), np.float32)


def stamped(picture: Grey) -> Grey:
    """With a time stamp in the upper left corner."""
    stamp = np.zeros((22, 130), np.uint8)
    cv2.putText(stamp, "12:34:56", (4, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.6, 255.0, 2)
    picture[:22, :130] = stamp
    return picture


def hot_pixel(picture: Grey) -> Grey:
    """With one pixel that is stuck, as in 16-bit thermal pictures stretched to grey values."""
    picture = (picture - 118) / 4 + 10
    picture[200, 50] = 255.0
    return np.asarray(picture, np.float32)


@pytest.mark.parametrize("spoil", [stamped, hot_pixel])
def test_a_scene_of_low_contrast_has_corners_beside_it(spoil) -> None:
    picture = spoil(fog(0))
    points = detect(picture, levels=1).points
    beside = (points[:, 0] > 140) | (points[:, 1] > 30)
    beside &= np.hypot(points[:, 0] - 50, points[:, 1] - 200) > 4
    assert beside.sum() > 300


def test_ordinary_pictures_keep_their_threshold() -> None:
    picture = 118 + 30 * (fog(1) - 118)
    strong = detect(picture, levels=1, quality=0.1)
    weak = detect(picture, levels=1, quality=1e-4)
    least = strong.responses.min() / weak.responses.max()
    assert 0.1 <= least < 0.2
    assert len(weak.points) > len(strong.points)


def test_a_blank_picture_has_no_corners() -> None:
    assert len(detect(np.full((60, 80), 90.0, np.float32), levels=1).points) == 0
