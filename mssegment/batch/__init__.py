"""Many runs at once: each item of a manifest, a pattern or a folder into a folder of its own.

An item's folder is whole or not there, and says what it was made from. The ledger beside it says
what was done, what failed and why. The same batch again does only what is missing or has changed.
"""

from __future__ import annotations

import os
from collections import Counter, deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, wait
from contextlib import contextmanager, suppress
from pathlib import Path

from mssegment.batch.fingerprint import fingerprint
from mssegment.batch.items import Item, items_of
from mssegment.batch.ledger import LEDGER, Entry, Ledger
from mssegment.batch.pools import Pool, WorkerDied
from mssegment.batch.work import WAIT, Facts, Outcome, Task, read_facts
from mssegment.errors import DataError, MssegmentError, OutputError, UsageError
from mssegment.folders import HIDDEN, folder_lock, sweep
from mssegment.progress import report
from mssegment.records import Record, State

__all__ = ["Batch", "Item", "Result", "items_of"]

ATTEMPTS = 3
"""How many processes may die over an item before it counts as failed."""
_DIED = (
    f"{ATTEMPTS} processes that worked on it were killed (out of memory?); try it alone with "
    "`mssegment run`"
)
_LOST = "the connection to the Dask scheduler is lost; run the same batch again to go on"


class Result(Record, frozen=True):
    """What became of an item.

    Attributes
    ----------
    item : Item
        The item.
    state : str
        ``done``, ``unchanged`` (its result was there), ``failed``, ``failed before`` (and not tried
        again), or ``not started``.
    fingerprint : str
        Of its files, its settings and the version; empty if a file cannot be read.
    facts : Facts or None
        What was found.
    error : str
        Why it failed.
    seconds : float
        The time that it took in this batch.
    worker : str
        The process that worked on it.
    """

    item: Item
    state: str
    fingerprint: str = ""
    facts: Facts | None = None
    error: str = ""
    seconds: float = 0.0
    worker: str = ""

    @property
    def has_failed(self) -> bool:
        """Whether there is no result because of an error."""
        return self.state.startswith("failed")


class Batch(State):
    """A batch of items.

    Attributes
    ----------
    items : list of Item
        What to do.
    out : str
        The folder of the ledger, the summary and the folders of the items.
    retry_failed : bool
        Whether items that failed before are tried again although nothing has changed.
    fail_fast : bool
        Whether to stop at the first item that fails.
    """

    items: Sequence[Item]
    out: str
    retry_failed: bool = False
    fail_fast: bool = False

    @contextmanager
    def opened(self) -> Iterator[Ledger]:
        """Hold the folder against other processes, without what a killed batch left in it.

        Raises
        ------
        UsageError
            If the folder holds other files than those of a batch, or another process writes it.
        OutputError
            If it cannot be written.
        """
        with folder_lock(self.out):
            folder = Path(self.out)
            if folder.is_dir() and os.listdir(folder) and not (folder / LEDGER).exists():
                raise UsageError(
                    f"{self.out}: this folder is not empty, and has no {LEDGER} of a batch; name "
                    "another with --out"
                )
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise OutputError.of(self.out, error) from None
            ledger = Ledger(folder)
            try:
                for entry in os.listdir(folder):
                    if entry.startswith(".") and entry.endswith(HIDDEN):
                        name = entry[1 : -len(HIDDEN)]
                        is_item = any(item.name == name for item in self.items)
                        sweep(str(folder / name), wait=WAIT, keep=is_item)
                yield ledger
            finally:
                ledger.close()

    def run(
        self,
        ledger: Ledger,
        pool: Pool,
        on_result: Callable[[Result], None] = lambda result: None,
    ) -> list[Result]:
        """Do what is missing or has changed.

        Parameters
        ----------
        ledger : Ledger
            The opened ledger; each item adds a line when it is done.
        pool : Pool
            The workers.
        on_result : callable
            Called with the result of each item, in the order in which they end.

        Returns
        -------
        list of Result
            In the order of the items.

        Raises
        ------
        OutputError
            If results cannot be written; the same batch goes on later.
        """
        results: dict[str, Result] = {}
        try:
            for result in self._results(ledger, pool):
                results[result.item.name] = result
                ledger.add(_entry(result))
                report(len(results), len(self.items), "items")
                on_result(result)
                if self.fail_fast and result.has_failed:
                    break
        finally:
            if len(results) < len(self.items):
                pool.stop()
                self._sweep(results)
        return [results.get(item.name, Result(item, "not started")) for item in self.items]

    def _results(self, ledger: Ledger, pool: Pool) -> Iterator[Result]:
        """The results of all items, in the order in which they end."""
        before, attempts = ledger.last(), Counter[str]()
        waiting = deque(self.items)
        again: deque[tuple[Item, Task]] = deque()
        running: dict[Future[Outcome], tuple[Item, Task]] = {}
        report(0, len(self.items), "items")
        while waiting or again or running:
            while (waiting or again) and len(running) < pool.width:
                if again:
                    item, task = again.popleft()
                else:
                    item = waiting.popleft()
                    found = self._begin(item, before.get(item.name))
                    if isinstance(found, Result):
                        yield found
                        continue
                    task = found
                running[pool.submit(task)] = item, task
            ended = wait(running, timeout=1.0, return_when=FIRST_COMPLETED).done
            if not ended and pool.is_lost:
                raise DataError(_LOST)
            for future in ended:
                item, task = running.pop(future)
                try:
                    yield _result(item, task, future.result())
                except WorkerDied:
                    attempts[item.name] += 1
                    if attempts[item.name] < ATTEMPTS:
                        again.append((item, task))
                    else:
                        yield Result(item, "failed", task.fingerprint.digest, error=_DIED)
                except CancelledError:
                    raise DataError(_LOST) from None

    def _begin(self, item: Item, before: Entry | None) -> Task | Result:
        """What is to be done for an item, or its result if there is nothing to do."""
        try:
            of = fingerprint(item.configuration)
        except MssegmentError as error:
            return Result(item, "failed", error=str(error))
        out = str(Path(self.out).absolute() / item.name)
        facts = read_facts(out)
        is_known = before is not None and before.fingerprint == of.digest
        if facts is not None and facts.fingerprint == of.digest:
            # a batch that was killed may not have come to say so
            state = "unchanged" if is_known else "done"
            return Result(item, state, of.digest, facts)
        if before is not None and is_known and before.state == "failed" and not self.retry_failed:
            return Result(item, "failed before", of.digest, error=before.error)
        return Task(item.name, item.configuration, out, of, os.getcwd())

    def _sweep(self, results: Mapping[str, Result]) -> None:
        """Remove what stopped workers left; a long clip goes on where it was."""
        for item in self.items:
            if item.name not in results:
                with suppress(UsageError):  # a worker of a cluster is still writing it
                    sweep(str(Path(self.out) / item.name), keep=True)


def _result(item: Item, task: Task, outcome: Outcome) -> Result:
    """The result of an item; raises OutputError if it cannot be written."""
    if outcome.cannot_write:
        raise OutputError(outcome.error)
    return Result(
        item,
        "failed" if outcome.error else "done",
        task.fingerprint.digest,
        outcome.facts,
        outcome.error,
        outcome.seconds,
        outcome.worker,
    )


def _entry(result: Result) -> Entry:
    state = {"unchanged": "skipped", "failed before": "skipped"}.get(result.state, result.state)
    return Entry(
        time="",
        name=result.item.name,
        state=state,
        fingerprint=result.fingerprint,
        seconds=round(result.seconds, 3),
        error=result.error,
        worker=result.worker,
    )
