"""Who works on the items: processes of this machine, or the workers of a Dask cluster."""

from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, CancelledError, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from typing import Any, Protocol

from mssegment.batch.shipping import Answer, Parcel, packed, segment_parcel, unpacked
from mssegment.batch.work import Outcome, Task, segment_item
from mssegment.errors import DataError, UsageError

PATIENCE = 20.0
"""Seconds to wait for a Dask scheduler."""


class WorkerDied(Exception):
    """The process that worked on an item has ended without an answer."""


class Pool(Protocol):
    """Workers."""

    @property
    def width(self) -> int:
        """The number of items that are worth submitting at a time."""

    @property
    def is_lost(self) -> bool:
        """Whether no answer will come any more."""

    def submit(self, task: Task) -> Future[Outcome]:
        """Have a worker segment an item; its future may raise WorkerDied."""

    def stop(self) -> None:
        """End the work on all items at once."""


class LocalPool:
    """Processes of this machine, each of them alone in its executor.

    A process that dies, by whatever signal, takes only its own item with it, and another one takes
    its place.

    Parameters
    ----------
    jobs : int
        Number of processes.
    threads : int
        Number of threads of each process for OpenCV.
    """

    is_lost = False

    def __init__(self, jobs: int, threads: int) -> None:
        self.width = jobs
        self._threads = threads
        self._free: list[Executor] = []
        self._processes: dict[Executor, list[Any]] = {}

    def submit(self, task: Task) -> Future[Outcome]:
        """Have a free process segment an item."""
        executor = self._free.pop() if self._free else self._new()
        before = set(multiprocessing.active_children())
        answer: Future[Outcome] = Future()
        with _interrupts_ignored():  # which a process that is started here inherits
            inner = executor.submit(segment_item, task)
        self._processes[executor] += set(multiprocessing.active_children()) - before
        inner.add_done_callback(lambda done: self._finish(executor, done, answer))
        return answer

    def stop(self) -> None:
        """End all processes; those that are at work are killed."""
        for processes in self._processes.values():
            for process in processes:
                process.kill()
        self.close()

    def close(self) -> None:
        """Wait for the processes to end."""
        for executor in self._processes:
            executor.shutdown(wait=True, cancel_futures=True)

    def _new(self) -> Executor:
        executor = ProcessPoolExecutor(
            1, multiprocessing.get_context("spawn"), _prepare_process, (self._threads,)
        )
        self._processes[executor] = []
        return executor

    def _finish(self, executor: Executor, done: Future[Outcome], answer: Future[Outcome]) -> None:
        if done.cancelled():
            answer.cancel()
            return
        error = done.exception()
        if isinstance(error, BrokenExecutor):
            answer.set_exception(WorkerDied())
            return
        self._free.append(executor)
        if error is None:
            answer.set_result(done.result())
        else:
            answer.set_exception(error)


@contextmanager
def _interrupts_ignored() -> Iterator[None]:
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    earlier = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, earlier)


def _prepare_process(threads: int) -> None:
    """At the start of a process: Ctrl-C is for its parent, with which it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    import warnings

    import cv2

    from mssegment.resources import keep_freed_memory

    cv2.setNumThreads(threads)
    keep_freed_memory()
    warnings.simplefilter("ignore", RuntimeWarning)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def local_pool(jobs: int, threads: int) -> Iterator[Pool]:
    """Processes of this machine; see ``LocalPool``."""
    pool = LocalPool(jobs, threads)
    try:
        yield pool
    except BaseException:
        pool.stop()
        raise
    pool.close()


class DaskPool:
    """The workers of a Dask cluster.

    Parameters
    ----------
    client : distributed.Client
        A client of its scheduler.
    ship : bool
        Whether the workers share no disk with this machine.
    """

    def __init__(self, client: Any, ship: bool = False) -> None:
        self._client, self._ship = client, ship
        self._executor = client.get_executor(pure=False)

    @property
    def width(self) -> int:
        """All items, as the scheduler scales its cluster by them; few that hold their files."""
        return 2 * max(1, sum(self._client.nthreads().values())) if self._ship else 1_000_000

    @property
    def is_lost(self) -> bool:
        """Whether the client has given up to reach the scheduler."""
        return self._client.status in ("closing", "closed")

    def submit(self, task: Task) -> Future[Outcome]:
        """Have a worker segment an item."""
        from distributed.scheduler import KilledWorker

        answer: Future[Outcome] = Future()

        def finish(done: Future[Any]) -> None:
            try:
                found = done.result()
                answer.set_result(unpacked(task, found) if self._ship else found)
            except CancelledError:
                answer.cancel()
            except KilledWorker:
                answer.set_exception(WorkerDied())
            except Exception as error:  # it is raised where the answer is waited for
                answer.set_exception(error)

        try:
            sent = packed(task) if self._ship else task
        except DataError as error:
            answer.set_result(Outcome(error=str(error), status=error.status))
            return answer
        self._executor.submit(_segment_on_one_core, sent).add_done_callback(finish)
        return answer

    def stop(self) -> None:
        """Take back all items; a worker completes the one that it has begun."""
        if not self.is_lost:
            self._executor.shutdown(wait=False)


def _segment_on_one_core(sent: Task | Parcel) -> Outcome | Answer:
    """Segment an item in a Dask worker, which has one core for each of its threads."""
    import cv2

    cv2.setNumThreads(1)
    return segment_parcel(sent) if isinstance(sent, Parcel) else segment_item(sent)


@contextmanager
def dask_pool(scheduler: str, jobs: int, ship: bool = False) -> Iterator[Pool]:
    """The workers of a Dask scheduler, or with ``local`` those of a cluster on this machine.

    With ``ship``, files go to the workers and results come back.

    Raises UsageError if Dask is not installed, DataError if there is no scheduler at the address.
    """
    try:
        import dask
        from distributed import Client, LocalCluster
    except ImportError:
        raise UsageError(
            "--scheduler: Dask is not installed; pip install 'mssegment[dask]'"
        ) from None
    with contextlib.ExitStack() as stack:
        dask.config.set({"logging.distributed": "error"})
        address: Any = scheduler
        if scheduler == "local":
            address = stack.enter_context(
                LocalCluster(n_workers=jobs, threads_per_worker=1, dashboard_address=None)
            )
        try:
            client = stack.enter_context(Client(address, timeout=PATIENCE, set_as_default=False))
        except (OSError, TimeoutError, ValueError) as error:
            raise DataError(
                f"--scheduler {scheduler}: no Dask scheduler answers ({error}); start one with "
                "`dask scheduler` and name its address, tcp://HOST:8786"
            ) from None
        pool = DaskPool(client, ship)
        try:
            yield pool
        except BaseException:
            pool.stop()
            raise
