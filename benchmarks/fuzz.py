"""Damaged and odd inputs of every kind: no traceback, no signal, no hang, no more than 1 GB.

    python -m benchmarks.fuzz --minutes 10 [--kind NAME...] [--seed N] [--out FOLDER]

The command line runs inside a worker process with a limit on its memory. A worker that dies by a
signal, or needs more than five seconds of CPU for an input, is replaced, and the input is kept.
What is found is listed once for each place in the code; FOLDER keeps the input of each, with its
command in ``command.txt``.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings

from benchmarks.fuzz_files import whole_files
from benchmarks.fuzz_inputs import KINDS, Case
from mssegment.cli import invoke

CPU_SECONDS = 5.0
WALL_SECONDS = 60.0
"""The machine may be busy: a worker that waits for long is stopped too."""
MEMORY = 2**30
"""Bytes that an input may need, beyond what the worker has when it starts."""
EXAMPLES, TURN_SECONDS = 500, 10.0
"""Inputs of one kind, and seconds, before the next one's turn."""
EXPECTED = (0, 2, 3, 4, 141)


def fault_of(status: int, said: str) -> str:
    """What is wrong with how a command ended; empty if nothing is."""
    errors = [line for line in said.splitlines() if line.startswith("mssegment: ")]
    if "Traceback" in said or status not in EXPECTED:
        return f"status {status}: {(errors or said.splitlines() or ['nothing said'])[-1]}"
    if status and len(errors) != 1:
        return f"{len(errors)} lines of error for status {status}"
    if status and not all(character.isprintable() for character in errors[0]):
        return f"an error that is not printable: {errors[0]!r}"
    return ""


def run_case(case: Case) -> tuple[int, str]:
    """Write the files of a case into this folder and run its command; status and stderr."""
    files, arguments = case
    for name, content in files.items():
        Path(name).write_bytes(content)
    said = io.StringIO()
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(out):
        status = invoke([*arguments, *([] if "--out" in arguments else ["--quiet"])])
    return int(status), said.getvalue()


def place_of(case: Case) -> str:
    """The exception of a case and where it is raised, by running it again."""
    _, arguments = case
    said = io.StringIO()
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(out):
        invoke([*arguments, "--debug"])
    places = re.findall(r'File ".*?/(\w+/\w+\.py)", line (\d+)', said.getvalue())
    last = said.getvalue().strip().splitlines()[-1:] or [""]
    own = [place for place in places if place[0].split("/")[0] != "click"]
    return f"{last[0][:160]} at {':'.join(own[-1]) if own else 'unknown'}"


def work(folder: Path, kinds: list[str], first_seed: int, stop: float) -> None:
    """The worker: run cases until ``stop``, telling the parent before and after each."""
    os.chdir(folder)
    invoke(["report", "segmentation.json", "--format", "json", "-o", "warm"])  # imports
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGESIZE")
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    turn = first_seed
    while time.time() < stop:
        for kind in kinds:
            turn += 1
            _turn(kind, KINDS[kind](folder), turn, min(stop, time.time() + TURN_SECONDS))


def _turn(kind: str, strategy: Any, number: int, stop: float) -> None:
    @seed(number)
    @settings(
        max_examples=EXAMPLES,
        deadline=None,
        database=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(strategy)
    def run(case: Case) -> None:
        if time.time() > stop:
            return
        _keep(case)
        _tell("start", kind)
        try:
            status, said = run_case(case)
            fault = fault_of(status, said)
            if fault and status == 1:
                fault = place_of(case)
        except BaseException as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            fault = f"{type(error).__name__} at {last.filename}:{last.lineno}"
        _tell("fault" if fault else "good", fault)

    run()


def _keep(case: Case) -> None:
    """The last case, where the parent finds it if this process dies."""
    files, arguments = case
    kept = {name: content.hex() for name, content in files.items()}
    Path("last.json").write_text(json.dumps({"files": kept, "arguments": arguments}))


def _tell(word: str, what: str) -> None:
    os.write(3, f"{word}\t{' '.join(what.split())}\n".encode("utf-8", "replace"))


class Parent:
    """Starts workers, watches them, and counts what they find."""

    def __init__(self, kinds: list[str], first_seed: int, out: Path | None) -> None:
        self.kinds, self.seed, self.out = kinds, first_seed, out
        self.runs: Counter[str] = Counter()
        self.faults: Counter[str] = Counter()

    def run(self, seconds: float) -> None:
        """Fuzz for some seconds."""
        stop = time.time() + seconds
        with tempfile.TemporaryDirectory(prefix="mssegment-fuzz-") as place:
            whole = Path(place) / "whole"
            whole.mkdir()
            here = Path.cwd()
            os.chdir(whole)
            try:
                whole_files(whole)
            finally:
                os.chdir(here)
            while time.time() < stop:
                self.seed += 1000
                self._worker(whole, Path(place) / "work", stop)

    def _worker(self, whole: Path, folder: Path, stop: float) -> None:
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(whole, folder)
        reading, writing = os.pipe()
        command = [sys.executable, "-m", "benchmarks.fuzz", "--worker", str(folder)]
        command += ["--seed", str(self.seed), "--stop", str(stop), "--kind", *self.kinds]
        process = subprocess.Popen(
            ["bash", "-c", f'exec 3>&{writing}; exec "$@"', "worker", *command],
            pass_fds=[writing],
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(writing)
        kind = ""
        try:
            kind = self._watch(process, reading, folder)
        finally:
            os.close(reading)
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGKILL)
            status = process.wait()
            if kind and status < 0 and status != -signal.SIGKILL:
                self._found(f"{kind}: killed by {signal.Signals(-status).name}", folder)
            elif kind and status > 0:
                self._found(f"{kind}: the worker ended with status {status}", folder)

    def _watch(self, process: subprocess.Popen[bytes], reading: int, folder: Path) -> str:
        """Follow a worker to its end; the kind of the input that it ended in, if it did."""
        import select

        kind, rest = "", b""
        started, cpu = time.time(), _cpu_of(process.pid)
        while True:
            ready = select.select([reading], [], [], 1.0)[0]
            if ready:
                piece = os.read(reading, 1 << 16)
                if not piece:
                    return kind
                *lines, rest = (rest + piece).split(b"\n")
                for line in lines:
                    word, _, what = line.decode("utf-8", "replace").partition("\t")
                    if word == "start":
                        kind = what
                        self.runs[kind] += 1
                    elif word == "fault":
                        self._found(f"{kind}: {what}", folder)
                        kind = ""
                    else:
                        kind = ""
                started, cpu = time.time(), _cpu_of(process.pid)
            elif kind and (
                _cpu_of(process.pid) - cpu > CPU_SECONDS or time.time() - started > WALL_SECONDS
            ):
                self._found(f"{kind}: more than {CPU_SECONDS:g} seconds", folder)
                os.killpg(process.pid, signal.SIGKILL)
                return ""

    def _found(self, fault: str, folder: Path) -> None:
        fault = re.sub(r"0x[0-9a-f]+|\b\d{4,}\b", "N", fault)
        self.faults[fault] += 1
        if self.faults[fault] > 1:
            return
        print(fault, flush=True)
        if self.out is None:
            return
        place = self.out / f"{len(self.faults):03d}"
        place.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(OSError, ValueError):
            case = json.loads((folder / "last.json").read_text())
            for name, content in case["files"].items():
                (place / name).write_bytes(bytes.fromhex(content))
            (place / "command.txt").write_text(f"{fault}\n{json.dumps(case['arguments'])}\n")


def _cpu_of(process: int) -> float:
    """Seconds of CPU that a process and its finished children have used."""
    try:
        fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return 0.0
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=1.0)
    parser.add_argument("--kind", nargs="+", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--out", type=Path, help="folder that keeps the inputs of faults")
    parser.add_argument("--worker", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--stop", type=float, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker is not None:
        work(options.worker, options.kind, options.seed, options.stop)
        return 0
    parent = Parent(options.kind, options.seed, options.out)
    parent.run(60 * options.minutes)
    total = sum(parent.runs.values())
    print(", ".join(f"{kind} {count}" for kind, count in parent.runs.items()))
    print(f"{total} inputs, {len(parent.faults)} kinds of faults in {sum(parent.faults.values())}")
    return 1 if parent.faults else 0


if __name__ == "__main__":
    sys.exit(main())
