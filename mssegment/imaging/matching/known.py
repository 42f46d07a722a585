"""The matchers of this package, described without loading them."""

from __future__ import annotations

from mssegment.imaging.matching.base import Matcher

_PACKAGE = __name__.rpartition(".")[0]

AFFINE = Matcher(
    "affine",
    f"{_PACKAGE}.affine",
    "oriented patches refined by affine Lucas-Kanade",
    max_frames=2,
    default_for=(2, 2),
)
PATCHES = Matcher("patches", f"{_PACKAGE}.patches", "correlation of upright patches", max_frames=2)
FLOW = Matcher("flow", f"{_PACKAGE}.klt", "pyramidal Lucas-Kanade", default_for=(3, None))
