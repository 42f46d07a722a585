"""From inliers to areas: smooth outlines around them, and dense regions that follow edges."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from mssegment.neighbours import nearest, pairs_within
from mssegment.records import BACKGROUND, LARGEST_COORDINATE, Floats
from mssegment.rendering.report import Picture, Report

Contours = tuple[Floats, ...]
"""Closed outlines, each [n, 2] in pixels."""
BinaryPicture = npt.NDArray[np.uint8]
"""[height, width], 0 or 255."""

SPACING_NEIGHBOUR = 3
"""The neighbour whose distance measures how densely an object is covered."""


def spacing(points: Floats, neighbour: int = SPACING_NEIGHBOUR, share: float = 0.5) -> float:
    """A quantile of the distances between points and their nearest neighbours.

    Parameters
    ----------
    points : float array [n, 2]
        Positions in pixels.
    neighbour : int
        Which nearest neighbour: 1 the nearest, 2 the second, ...
    share : float
        The quantile, 0.5 for the median.

    Returns
    -------
    float
        Distance in pixels, 0 for fewer than two points.
    """
    if len(points) < 2:
        return 0.0
    count = min(neighbour, len(points) - 1)
    points = np.clip(points, -LARGEST_COORDINATE, LARGEST_COORDINATE)
    distances, _ = nearest(points, points, count + 1)
    return float(np.quantile(distances[:, -1], share))


def not_isolated(points: Floats) -> npt.NDArray[np.bool_]:
    """Select the points of one motion that lie among others, to ignore wrong inliers far away.

    Points within twice the typical spacing are connected. A connected component counts if it has
    at least three points and a twentieth of all.

    Parameters
    ----------
    points : float array [n, 2]
        Positions of the inliers, pixels.

    Returns
    -------
    bool array [n]
    """
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import connected_components

    count = len(points)
    if count < 3:
        return np.zeros(count, dtype=bool)
    pairs = pairs_within(points, 2.0 * spacing(points))
    links = coo_matrix((np.ones(len(pairs)), pairs.T), shape=(count, count))
    _, group = connected_components(links, directed=False)
    sizes = np.bincount(group)
    least = min(int(sizes.max()), max(3, count // 20))
    return np.asarray(sizes[group] >= least)


def hulls(points: Floats, width: int, height: int) -> Contours:
    """Smooth outlines around the points of one motion, as tight as their spacing allows.

    Discs around the points that are not isolated, closed morphologically and smoothed.

    Parameters
    ----------
    points : float array [n, 2]
        Positions of the inliers, pixels; NaN where not visible.
    width, height : int
        Size of the picture.

    Returns
    -------
    tuple of float array [k, 2]
        Closed outlines within the picture; empty for fewer than three points.
    """
    points = points[_near(points, width, height)]
    points = points[not_isolated(points)]
    if len(points) < 3:
        return ()
    step = max(1.0, max(width, height) / 400)  # a coarse mask gives the same smooth outline
    radius = float(np.clip(1.5 * spacing(points), 6 * step, 0.08 * max(width, height)))
    origin = points.min(axis=0) - 2 * radius
    size = np.ceil((points.max(axis=0) + 2 * radius - origin) / step).astype(int) + 1
    mask = np.zeros((int(size[1]), int(size[0])), dtype=np.uint8)
    for x, y in np.round((points - origin) / step).astype(int):
        cv2.circle(mask, (int(x), int(y)), max(1, round(radius / step)), 255, -1)
    mask = _smooth(mask, max(1, round(radius / step)))
    contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    limits = np.array([width - 1, height - 1])
    return tuple(
        np.clip(contour[::2, 0].astype(np.float64) * step + origin, 0, limits)
        for contour in contours
        if len(contour) >= 8
    )


def _near(points: Floats, width: int, height: int) -> npt.NDArray[np.bool_]:
    """Which points [n, 2] lie in the picture or within half its size from it."""
    size = np.array([width, height])
    return np.asarray((np.abs(np.nan_to_num(points, nan=np.inf) - size / 2) <= size).all(axis=1))


def _smooth(mask: BinaryPicture, radius: int) -> BinaryPicture:
    """Close gaps as wide as the radius, erode by half of it, and round the corners."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1,) * 2)
    half = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * (radius // 2) + 1,) * 2)
    eroded = cv2.erode(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, kernel), half)
    blurred = cv2.GaussianBlur(eroded, (0, 0), max(1.0, radius / 4))
    return np.asarray((blurred > 127).astype(np.uint8) * 255)


def dense_labels(report: Report, index: int, picture: Picture) -> npt.NDArray[np.int64]:
    """Label every pixel of a frame by watershed (Meyer 1992) on the edges of its picture.

    Regions grow from discs around the inliers. Pixels far from all inliers, and background tracks,
    are seeds of the region without motion.

    Parameters
    ----------
    report : Report
        The segmentation.
    index : int
        Number of the frame.
    picture : uint8 array [height, width, 3]
        Picture of the frame, possibly enlarged.

    Returns
    -------
    int array [height, width]
        1..m motions, 0 elsewhere.
    """
    height, width = picture.shape[:2]
    frame = report.frames[index]
    scale = width / frame.width
    points = (report.tracks.points[:, index] + 0.5) * scale - 0.5
    markers = _markers(report, points, height, width)
    smooth = cv2.medianBlur(picture, 5)
    cv2.watershed(smooth, markers)
    # watershed lines are -1: fill them from their neighbours
    markers = np.where(markers < 0, 0, markers).astype(np.float32)
    filled = np.where(markers > 0, markers, cv2.dilate(markers, np.ones((3, 3), np.uint8)))
    labels = filled.astype(np.int64)
    no_motion = len(report.motions) + 1
    return np.where(labels == no_motion, 0, labels)


def _markers(report: Report, points: Floats, height: int, width: int) -> npt.NDArray[np.int32]:
    """Seeds of the watershed [height, width]: 0 unknown, 1..m motions, m + 1 no motion."""
    near = _near(points, width, height)
    no_motion = len(report.motions) + 1
    markers = np.full((height, width), no_motion, dtype=np.int32)
    seeds = []
    for motion in report.motions:
        own = points[near & (report.labels == motion.label)]
        own = own[not_isolated(own)]
        radius = max(6.0, 2.0 * spacing(own, share=0.9))
        for x, y in own:
            cv2.circle(markers, (round(x), round(y)), round(radius), 0, -1)
        seeds += [(round(x), round(y), motion.label) for x, y in _moved_inwards(own)]
    for x, y in points[near & (report.labels == BACKGROUND)]:
        seeds.append((round(x), round(y), no_motion))
    for x, y, label in seeds:
        cv2.circle(markers, (x, y), 1, label, -1)
    return markers


def _moved_inwards(points: Floats) -> Floats:
    """Points moved a third of the way to the mean of their neighbours.

    Corners lie on the edge of an object, where a seed would leak out of it.
    """
    if len(points) < 2:
        return points
    _, around = nearest(points, points, min(6, len(points)))
    return np.asarray(points + (points[around].mean(axis=1) - points) / 3)


def dense_regions(report: Report, index: int, picture: Picture) -> dict[int, Contours]:
    """Label of a motion -> outlines of ``dense_labels``, in pixels of ``picture``."""
    labels = dense_labels(report, index, picture)
    kernel = np.ones((5, 5), dtype=np.uint8)
    regions = {}
    for motion in report.objects:
        mask = (labels == motion.label).astype(np.uint8)
        mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, kernel)
        contours, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
        least = 0.02 * mask.sum()
        regions[motion.label] = tuple(
            contour[:, 0].astype(np.float64)
            for contour in contours
            if len(contour) >= 3 and cv2.contourArea(contour) >= least
        )
    return regions
