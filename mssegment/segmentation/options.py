"""The settings of ``cluster`` as one record, and which strategies use them."""

from __future__ import annotations

from typing import Literal

from mssegment.errors import ConfigurationError, UsageError
from mssegment.records import Record, Strategy

Granularity = Literal["object", "surface", "auto", "none"]
"""What a motion is: a rigid body, a planar surface, or what the model finds."""


class SegmentOptions(Record, frozen=True):
    """How hypotheses become motions.

    Attributes
    ----------
    bandwidth : float or "auto"
        Bandwidth h in the distance of the manifold; ``auto`` estimates it from nearest neighbours.
    kernel : str
        A name in ``meanshift.KERNELS``.
    selection : str
        A name in ``segmentation.SELECTIONS``.
    motions : int, optional
        The number of motions, if it is known.
    min_motions : int
        The least number of motions, if their number is not known.
    granularity : {"object", "surface", "auto", "none"}
        Whether a motion is that of a rigid object, of a planar surface, or what the model finds,
        with parallax as noise but nothing joined; for models that predict points.
    threads : int
        Number of threads of mean shift; the result does not depend on it.
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
"""Options that only these strategies use."""


def check_options(options: SegmentOptions, strategy: Strategy) -> None:
    """Check that every option that is set is used by the strategy.

    Raises
    ------
    ConfigurationError, UsageError
        If an option is set that ``strategy`` does not use; the message contains its key.

    Examples
    --------
    >>> check_options(SegmentOptions(granularity="surface"), "modes")
    >>> check_options(SegmentOptions(granularity="surface"), "consensus")  # doctest: +ELLIPSIS
    Traceback (most recent call last):
        ...
    mssegment.errors.ConfigurationError: segment.granularity is surface, but strategy consensus ...
    """
    defaults = SegmentOptions()
    for name, users in USED_ONLY_BY.items():
        value, default = getattr(options, name), getattr(defaults, name)
        if strategy in users or value == default:
            continue
        key, error = (
            ("threads", UsageError)
            if name == "threads"
            else (f"segment.{name}", ConfigurationError)
        )
        raise error(
            f"{key} is {value}, but strategy {strategy} of these hypotheses does not use it: "
            f"leave it at {default}, or draw hypotheses for strategy {' or '.join(users)} "
            "(cluster.method meanshift)"
        )
