"""The settings of ``cluster`` as one record, and which of them a strategy uses."""

from __future__ import annotations

from typing import Literal

from mssegment.errors import ConfigurationError, UsageError
from mssegment.records import Record, Strategy

Granularity = Literal["object", "surface", "auto"]


class SegmentOptions(Record, frozen=True):
    """How hypotheses become motions.

    Attributes
    ----------
    bandwidth
        h of the kernel, in the distance of the manifold; ``auto``: by nearest neighbours.
    kernel
        A name in ``meanshift.KERNELS``.
    selection
        A name in ``segmentation.SELECTIONS``.
    motions
        The number of motions where it is known, else None.
    min_motions
        The least number of motions where it is not known.
    granularity
        What a motion is under a model that predicts points.
    threads
        Of mean shift; the result does not depend on them.
    """

    bandwidth: float | Literal["auto"] = "auto"
    kernel: str = "gaussian"
    selection: str = "mdl"
    motions: int | None = None
    min_motions: int = 0
    granularity: Granularity = "object"
    threads: int = 1


USED_ONLY_BY: dict[str, tuple[Strategy, ...]] = {
    "selection": ("modes",),
    "granularity": ("modes",),
    "threads": ("modes", "mixture"),
}
"""The options that only these strategies use."""


def check_options(options: SegmentOptions, strategy: Strategy) -> None:
    """Raises an error that names an option which was set although ``strategy`` does not use it."""
    standard = SegmentOptions()
    for name, users in USED_ONLY_BY.items():
        value, usual = getattr(options, name), getattr(standard, name)
        if strategy in users or value == usual:
            continue
        key, error = (
            ("--threads", UsageError)
            if name == "threads"
            else (f"segment.{name}", ConfigurationError)
        )
        wanted = " or ".join(users)
        raise error(
            f"{key} is {value}, but strategy {strategy} of these hypotheses does not use it: "
            f"leave it at {usual}, or draw hypotheses for strategy {wanted} "
            "(cluster.method meanshift)"
        )
