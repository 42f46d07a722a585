"""Run a folder of small cases, and print what happened beside what is expected.

    python -m benchmarks.cases FOLDER [NAME...]

A case is a folder with a file ``cmd``, which a user would type inside it, and a file ``expect``,
which says in words what is right. The folder is copied before it runs, so nothing is written into
it. Every case runs in a child process: a decoder that kills its process is one line of the table.

The summary judges only what needs no reading: processes that were killed, internal errors, errors
of more than one line, and a number of motions other than the one that ``expect`` begins with.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import mssegment
from mssegment.records import Record

ROOT = Path(mssegment.__file__).parents[1]
APART = "hostile"
"""A folder of inputs that attack the program; they are no cases of users."""
LONGEST = 300.0
"""Seconds after which a case is stopped."""
_COUNT = re.compile(r"^(\d+) motions? in ", re.M)
_WANTED = re.compile(r"^(\d+) motions?\b")
_WRONG = re.compile(r"; ([\d.]+) % of \d+ evaluated")


class Outcome(Record, frozen=True):
    """What a case did: exit status (negative: the signal that killed it), output, seconds."""

    name: str
    expect: str
    status: int
    stdout: str
    stderr: str
    seconds: float

    @property
    def motions(self) -> int | None:
        """The number of motions that the tables state; None without tables."""
        found = _COUNT.findall(self.stdout)
        return int(found[-1]) if found else None

    @property
    def errors(self) -> list[str]:
        """The lines of errors on standard error."""
        return [line for line in self.stderr.splitlines() if line.startswith("mssegment: ")]

    @property
    def happened(self) -> str:
        """One line: the signal, the error, or the motions and the misclassification."""
        if self.status < 0:
            return f"killed by {signal.Signals(-self.status).name}"
        if self.status:
            lines = self.errors or self.stderr.splitlines()[-1:] or ["no message"]
            return f"exit {self.status}: {lines[-1].removeprefix('mssegment: ')}"
        if self.motions is None:
            return " / ".join(self.stdout.strip().splitlines()[-3:]) or "no output"
        wrong = _WRONG.search(self.stdout)
        return f"{self.motions} motion{'s' * (self.motions != 1)}" + (
            f", {wrong[1]} % misclassified" if wrong else ""
        )

    @property
    def faults(self) -> list[str]:
        """What is wrong whatever ``expect`` says in words."""
        wanted = _WANTED.match(self.expect)
        found = []
        if self.status < 0 or self.status == 1 or self.status > 128:
            found.append("crash")
        if "Traceback" in self.stderr or len(self.errors) > 1:
            found.append("more than one line of error")
        if wanted and self.status == 0 and self.motions not in (None, int(wanted[1])):
            found.append(f"expected {wanted[1]} motions")
        return found

    @property
    def notes(self) -> list[str]:
        """The notes of the stages."""
        return [line.strip() for line in self.stderr.splitlines() if line.startswith(" " * 12)]


def cases_of(folder: Path, names: Sequence[str] = ()) -> list[Path]:
    """The folders of the cases, sorted; those whose name begins with one of ``names``, if any."""
    found = sorted(path.parent for path in folder.glob("*/cmd") if path.parent.name != APART)
    return [case for case in found if not names or case.name.startswith(tuple(names))]


def run_case(case: Path, seconds: float = LONGEST) -> Outcome:
    """Run the command of one case in a copy of the folder of cases, in a child process."""
    with tempfile.TemporaryDirectory(prefix="mssegment-cases-") as place:
        inside = _prepare(case, Path(place))
        command = (case / "cmd").read_text(encoding="utf-8", errors="surrogateescape")
        start = time.perf_counter()
        process = subprocess.Popen(
            ["bash", "-c", command],
            cwd=inside,
            env=_environment(Path(place)),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
        )
        try:
            out, err = process.communicate(timeout=seconds)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            out, err = process.communicate()
        return Outcome(
            case.name,
            " ".join((case / "expect").read_text(encoding="utf-8", errors="replace").split()),
            _signal_of(process.returncode),
            out.decode(errors="replace"),
            err.decode(errors="replace"),
            time.perf_counter() - start,
        )


def _prepare(case: Path, place: Path) -> Path:
    """A copy of the case among links to the others, which commands name as ``../NAME``."""
    cases = place / "cases"
    cases.mkdir()
    for other in case.parent.iterdir():
        if other.is_dir() and other != case:
            (cases / other.name).symlink_to(other.resolve())
    inside = cases / case.name
    shutil.copytree(case, inside)
    if not (inside / "sample_data").exists():
        (inside / "sample_data").symlink_to(ROOT / "sample_data")
    program = place / "bin" / "mssegment"
    program.parent.mkdir()
    code = "from mssegment.cli import main; main()"
    _script(program, f'"{sys.executable}" -c "{code}"')
    _script(program.with_name("python"), f'"{sys.executable}"')
    return inside


def _script(path: Path, command: str) -> None:
    path.write_text(f'#!/bin/sh\nexec {command} "$@"\n')
    path.chmod(0o755)


def _environment(place: Path) -> dict[str, str]:
    paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]
    before = [str(place / "bin"), str(Path(sys.executable).parent), os.environ.get("PATH", "")]
    return os.environ | {"PYTHONPATH": ":".join(filter(None, paths)), "PATH": ":".join(before)}


def _signal_of(status: int) -> int:
    """A shell reports a killed child as 128 + signal; the program itself exits with 130 and 141."""
    return 128 - status if status > 128 and status not in (130, 141) else status


def print_outcome(outcome: Outcome) -> None:
    """Print one case: what happened, the notes, and what is expected."""
    fault = f"   <-- {', '.join(outcome.faults)}" if outcome.faults else ""
    print(f"{outcome.name} ({outcome.seconds:.1f} s){fault}")
    print(f"    happened  {outcome.happened}")
    for note in outcome.notes:
        print(f"              {note}")
    print(f"    expected  {outcome.expect}", flush=True)


def main() -> None:
    """Run all cases of a folder, or those whose names begin as given."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("names", nargs="*", help="run only cases whose names begin like this")
    arguments = parser.parse_args()
    cases = cases_of(arguments.folder, arguments.names)
    if not cases:
        parser.error(f"{arguments.folder}: no folder in it has a file cmd")
    outcomes = []
    for case in cases:
        outcomes.append(run_case(case))
        print_outcome(outcomes[-1])
    failed = [outcome for outcome in outcomes if outcome.faults]
    print(f"\n{len(outcomes)} cases; {len(failed)} certainly wrong", end="")
    print(f": {', '.join(outcome.name for outcome in failed)}" if failed else "")


if __name__ == "__main__":
    main()
