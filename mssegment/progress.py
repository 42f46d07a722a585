"""How far a stage has come, from the loops that do the work to whoever listens.

The loops know nothing of a terminal: without a listener they only loop.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

T = TypeVar("T")
Listener = Callable[[int, int | None, str], None]
"""Called with the number of things that are done, of all or None, and what they are called."""

_LISTENER: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Call ``listener`` from the loops that run inside this block, in this thread."""
    token = _LISTENER.set(listener)
    try:
        yield
    finally:
        _LISTENER.reset(token)


def report(done: int, total: int | None, what: str) -> None:
    """Tell the listener, if there is one."""
    listener = _LISTENER.get()
    if listener is not None:
        listener(done, total, what)


def track(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
    """The items, reporting each when the next one is asked for.

    Parameters
    ----------
    items : iterable
        What a loop goes through.
    what : str
        What the items are called, in the plural.
    total : int, optional
        Their number; by default their length, if they have one.

    Examples
    --------
    >>> with listening(lambda done, total, what: print(done, total, what)):
    ...     letters = list(track("ab", "letters"))
    0 2 letters
    1 2 letters
    2 2 letters
    """
    if total is None:
        size = getattr(items, "__len__", None)
        total = None if size is None else int(size())
    done = 0
    report(done, total, what)
    for item in items:
        yield item
        done += 1
        report(done, total, what)
