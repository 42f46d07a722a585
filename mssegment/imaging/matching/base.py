"""What the registry knows of a matcher before the matcher itself is loaded."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module

from mssegment.records import Record, Tracks


class Matcher(Record, frozen=True):
    """A matcher as the registry lists it.

    Its module is imported when ``function`` is first used, so that names and descriptions serve
    help texts and option choices without loading OpenCV.

    Parameters
    ----------
    name : str
        The value of ``match.method`` that selects it.
    module : str
        Full name of the module that defines ``match(pictures, corners, *, ...) -> Tracks``.
    description : str
        What it does, as a phrase for help texts and documentation.
    max_frames : int or None
        Largest number of frames that it takes; None for no limit.
    default_for : tuple of (int, int or None), or None
        Smallest and largest number of frames for which ``auto`` selects it; a largest number of
        None is no limit, and a matcher with None is never selected by ``auto``.
    """

    name: str
    module: str
    description: str
    max_frames: int | None = None
    default_for: tuple[int, int | None] | None = None

    @property
    def function(self) -> Callable[..., Tracks]:
        """The function ``match(pictures, corners, **options) -> Tracks`` of its module."""
        function: Callable[..., Tracks] = import_module(self.module).match
        return function

    @property
    def options(self) -> tuple[str, ...]:
        """Names of the options it accepts: the keyword-only parameters of ``function``."""
        return tuple(getattr(self.function, "__kwdefaults__", None) or ())

    def is_default_for(self, frames: int) -> bool:
        """Whether ``auto`` selects it for this number of frames."""
        if self.default_for is None:
            return False
        first, last = self.default_for
        return first <= frames and (last is None or frames <= last)
