"""The bar that shows, on a terminal, how far a stage has come."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console as RichConsole
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from mssegment.progress import listening

REFRESH = 0.1
"""Seconds between two changes of the bar."""


class CountColumn(ProgressColumn):
    """What is done, of how many, and how many a second: ``12/40 frames, 8.1/s``."""

    def render(self, task: Task) -> Text:
        """The text for a task; empty before the first thing is done."""
        what = task.fields.get("what", "")
        if not what:
            return Text("")
        total = "" if task.total is None else f"/{task.total:.0f}"
        rate = f", {task.speed:.1f}/s" if task.speed else ""
        return Text(f"{task.completed:.0f}{total} {what}{rate}")


@contextmanager
def stage_bar(text: str) -> Iterator[Callable[[str], None]]:
    """Show a bar on stderr while the block runs; the loops of ``mssegment.progress`` move it.

    Yields a function that names the next stage.
    """
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(bar_width=20),
        CountColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=RichConsole(stderr=True), transient=True) as progress:
        task = progress.add_task(text, total=None, what="")
        shown = ("", 0.0)

        def change(name: str) -> None:
            restart(0, None, "")
            progress.update(task, description=name)

        def restart(done: int, total: int | None, what: str) -> None:
            progress.tasks[0].total = total  # for `reset`, None means that the total stays
            progress.reset(task, completed=done, what=what)

        def listen(done: int, total: int | None, what: str) -> None:
            nonlocal shown
            now = time.monotonic()
            if what != shown[0]:
                restart(done, total, what)  # other things: their rate begins anew
            elif done != total and now - shown[1] < REFRESH:
                return
            shown = what, now
            progress.update(task, completed=done, total=total, what=what)

        with listening(listen):
            yield change
