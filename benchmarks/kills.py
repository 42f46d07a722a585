"""Kills at random moments: ``python -m benchmarks.kills --count 200``.

A command (``run``, ``run --force`` over an earlier result, ``run`` of a sequence, of a clip in
windows, ``batch``, ``label`` during a save) gets SIGKILL, SIGTERM or SIGINT at a random moment, and
is then given again. At no moment there may be a result that is neither the earlier one nor the new
one; at the end it must be that of an undisturbed command, with nothing else in the folder and no
process left.
"""

from __future__ import annotations

import argparse
import contextlib
import http.client
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
SAMPLES = ROOT / "sample_data"
PROGRAM = (sys.executable, "-m", "mssegment")
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
EXPECTED = {
    signal.SIGKILL: {-signal.SIGKILL},
    # by its default action, before the program has begun
    signal.SIGTERM: {143, -signal.SIGTERM},
    signal.SIGINT: {130, -signal.SIGINT},
}
"""Exit statuses after each signal; 0 where the command had come to its end before."""
_TIMES = ("timings.json", "ledger.jsonl")
"""Files that hold times."""
_PATIENCE = 120.0


class Trouble(Exception):
    """What must not be, in a sentence."""


def contents(folder: Path) -> dict[str, bytes]:
    """All files in a folder but those that hold times; hidden ones too."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in _TIMES
    }


class Running:
    """A command in a session of its own, as in a terminal."""

    def __init__(self, arguments: Sequence[str], folder: Path) -> None:
        self.process = subprocess.Popen(
            [*PROGRAM, *arguments],
            cwd=folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
            env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])},
        )

    def kill(self, number: signal.Signals, to_all: bool) -> None:
        """Send a signal to the process, or, as Ctrl-C does, to all processes of the terminal."""
        if self.process.poll() is None:
            (os.killpg if to_all else os.kill)(self.process.pid, number)

    def end(self, statuses: set[int]) -> str:
        """Wait for the end, and that no process is left; what was said on standard error."""
        _, said = self.process.communicate(timeout=_PATIENCE)
        until = time.monotonic() + 10
        while left := _session(self.process.pid):
            if time.monotonic() > until:
                raise Trouble(f"processes {left} are left")
            time.sleep(0.02)
        if self.process.returncode not in statuses:
            raise Trouble(f"status {self.process.returncode}, expected {sorted(statuses)}: {said}")
        return said


def _session(leader: int) -> list[int]:
    """The processes of a session that still run."""
    found = []
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:
            continue
        if fields[3] == str(leader) and fields[0] != "Z":
            found.append(int(path.parent.name))
    return found


class Victim:
    """A command that is killed; ``whole`` says whether what it has written is."""

    def __init__(self, name: str, arguments: Sequence[str], folder: Path) -> None:
        self.name, self.arguments, self.folder = name, list(arguments), folder
        self.earlier: dict[str, bytes] = {}

    def prepare(self) -> None:
        """The undisturbed result, and the time that it takes."""
        start = time.monotonic()
        self.run("undisturbed")
        self.seconds = time.monotonic() - start
        self.whole = contents(self.folder / "undisturbed")

    def run(self, out: str, *further: str) -> None:
        """Run the command to its end."""
        Running([*self.arguments, "--out", out, *further], self.folder).end({0})

    def begin(self) -> None:
        """What is there before the command."""

    def check(self) -> None:
        """After the kill: the earlier result, or the new one."""
        found = contents(self.folder / "out") if (self.folder / "out").exists() else {}
        if found not in (self.earlier, self.whole):
            raise Trouble(f"a mixture: {sorted(found)}")

    def again(self) -> None:
        """Give the same command again; where its result is there, it is refused, and sweeps."""
        out = self.folder / "out"
        is_whole = out.exists() and contents(out) == self.whole and not self.earlier
        Running([*self.arguments, "--out", "out"], self.folder).end({2 if is_whole else 0})

    def kill(self, rng: np.random.Generator, number: signal.Signals) -> str:
        """Kill the command at a random moment, and give it again; how far it had come."""
        shutil.rmtree(self.folder / "out", ignore_errors=True)
        self.begin()
        running = Running([*self.arguments, "--out", "out"], self.folder)
        time.sleep(rng.uniform(0, 1.1 * self.seconds))
        running.kill(number, to_all=number == signal.SIGINT and rng.random() < 0.5)
        said = running.end({0} | EXPECTED[number])
        if "Traceback" in said and "mssegment" in said:
            raise Trouble(said)
        self.check()
        self.again()
        if (found := contents(self.folder / "out")) != self.whole:
            raise Trouble(f"another result: {sorted(found)}")
        if hidden := [path.name for path in self.folder.glob(".*")]:
            raise Trouble(f"left: {hidden}")
        return "ended before" if running.process.returncode == 0 else "killed"


class Forced(Victim):
    """``run --force`` over the result of other settings, with a file of the user in it."""

    def prepare(self) -> None:
        """Also the earlier result, and what the user has put beside it."""
        self.run("earlier", "--seed", "7", "--set", "report.html=no")
        (self.folder / "earlier" / "mine.txt").write_text("my own")
        self.earlier = contents(self.folder / "earlier")
        super().prepare()
        self.whole["mine.txt"] = b"my own"
        self.arguments.append("--force")

    def begin(self) -> None:
        """A copy of the earlier result."""
        shutil.copytree(self.folder / "earlier", self.folder / "out")


class Batch(Victim):
    """``batch``, of which each item is whole or not there."""

    def check(self) -> None:
        """Each folder of an item is that of an undisturbed batch."""
        for name, content in contents(self.folder / "out").items():
            is_hidden = any(part.startswith(".") for part in Path(name).parts)
            is_shared = "/" not in name  # the summary and the index
            if not is_hidden and not is_shared and content != self.whole.get(name):
                raise Trouble(f"{name} is not whole")

    def again(self) -> None:
        """The same batch: it goes on, and every item is done once."""
        self.run("out")
        lines = (self.folder / "out" / "ledger.jsonl").read_text().splitlines()
        entries = [json.loads(line) for line in lines]
        done = Counter(entry["name"] for entry in entries if entry["state"] == "done")
        if set(done.values()) != {1}:
            raise Trouble(f"done more than once: {done}")


class Label(Victim):
    """``label``, killed about the time of a save; the masks are those of the polygons."""

    def prepare(self) -> None:
        """The masks of each drawing."""
        self.whole, self.seconds = {}, 0.3
        self.drawings = {}
        for label in (1, 2):
            shutil.rmtree(self.folder / "out", ignore_errors=True)
            running, server = self._serve()
            self._save(server, label)
            running.kill(signal.SIGINT, to_all=False)
            running.end({0})
            self.drawings[label] = contents(self.folder / "out")

    def kill(self, rng: np.random.Generator, number: signal.Signals) -> str:
        """Kill the server about the time of a save; the next one completes it."""
        shutil.rmtree(self.folder / "out", ignore_errors=True)
        running, server = self._serve()
        self._save(server, 1)
        saving = threading.Thread(target=self._save, args=(server, 2), daemon=True)
        saving.start()
        time.sleep(rng.uniform(0, 0.02))
        running.kill(number, to_all=False)
        running.end({0} | EXPECTED[number])
        saving.join()
        again, _ = self._serve()
        again.kill(signal.SIGINT, to_all=False)
        again.end({0})
        found = contents(self.folder / "out")
        if found not in self.drawings.values():
            raise Trouble(f"masks of other polygons: {sorted(found)}")
        if hidden := [path.name for path in self.folder.glob(".*")]:
            raise Trouble(f"left: {hidden}")
        return "saved" if found == self.drawings[2] else "not saved"

    def _serve(self) -> tuple[Running, str]:
        """Start the server; its address."""
        running = Running([*self.arguments, "--out", "out"], self.folder)
        assert running.process.stdout is not None
        line = running.process.stdout.readline()
        if not line.startswith("http://"):
            raise Trouble(f"no address: {running.process.communicate()[1]}")
        return running, line.split()[0].removeprefix("http://")

    @staticmethod
    def _save(server: str, label: int) -> None:
        """Save a drawing as the page does; the server may die meanwhile."""
        host, _, secret = server.strip("/").partition("/")
        points = [[[10, 10], [300, 10], [300, 200]], [[20, 20], [310, 20], [310, 210]]]
        frames = [[{"label": label, "points": corners}] for corners in points]
        headers = {"Origin": f"http://{host}", "Content-Type": "application/json"}
        connection = http.client.HTTPConnection(host, timeout=30)
        with contextlib.suppress(OSError, http.client.HTTPException):
            connection.request("POST", f"/{secret}/save", json.dumps({"frames": frames}), headers)
            connection.getresponse().read()
        connection.close()


def victims(folder: Path, chosen: Sequence[str] = (), quick: bool = False) -> Iterator[Victim]:
    """The commands, each prepared in a folder of its own; ``quick`` needs few seconds."""
    pair = [str(SAMPLES / "affine" / f"frame-{number}.png") for number in (1, 2)]
    clip = [str(SAMPLES / "factorization" / f"frame-{number}.png") for number in range(1, 6)]
    plain = ["--set", "report.pictures=no", "--set", "report.html=no"] if quick else []
    rng = np.random.default_rng(0)
    (folder / "matches").mkdir()
    for item in range(4 if quick else 8):
        first = rng.uniform(0, 480, (120, 2))
        second = np.where(np.arange(120)[:, None] < 60, first + 12, 1.1 * first - 30)
        table = np.hstack([first, second])
        np.savetxt(folder / "matches" / f"{item}.csv", table, delimiter=",")
    matches = str(folder / "matches")
    short = [f"{matches}/0.csv"] if quick else pair
    kinds: dict[str, tuple[type[Victim], list[str]]] = {
        "run": (Victim, ["run", *short, "-q", *plain]),
        "force": (Forced, ["run", *short, "-q", *plain]),
        "sequence": (Victim, ["run", *clip, "-q", "--masks", *plain]),
        "clip": (Victim, ["run", str(_clip(folder)), "-q", "--set", "sequence.window=8", *plain]),
        "batch": (Batch, ["batch", matches, "-q", "--jobs", "2", "--model", "affine", *plain]),
        "label": (Label, ["label", *pair]),
    }
    for name in chosen or kinds:
        kind, arguments = kinds[name]
        (folder / name).mkdir()
        victim = kind(name, arguments, folder / name)
        victim.prepare()
        yield victim


def _clip(folder: Path) -> Path:
    """A clip of 40 frames, which goes forwards and backwards through those of a sample scene."""
    clip = folder / "frames"
    clip.mkdir()
    order = [1, 2, 3, 4, 5, 4, 3, 2]
    for index in range(40):
        name = f"frame-{order[index % len(order)]}.png"
        shutil.copy(SAMPLES / "factorization" / name, clip / f"{index:03d}.png")
    return clip


def kill_all(
    folder: Path,
    count: int,
    seed: int,
    chosen: Sequence[str] = (),
    quick: bool = False,
    on_kill: Callable[[str, str, str], None] = lambda victim, number, end: None,
) -> list[str]:
    """Kill the commands in turn, with each signal in turn; what went wrong."""
    prepared = list(victims(folder, chosen, quick))
    troubles = []
    for index in range(count):
        rng = np.random.default_rng([seed, index])
        victim = prepared[index % len(prepared)]
        number = SIGNALS[index // len(prepared) % len(SIGNALS)]
        try:
            end = victim.kill(rng, number)
        except (Trouble, subprocess.TimeoutExpired) as error:
            end = "WRONG"
            troubles.append(f"{victim.name}, {number.name}, kill {index}: {error}")
            shutil.rmtree(victim.folder / "out", ignore_errors=True)
        on_kill(victim.name, number.name, end)
    return troubles


def main() -> None:
    """Kill, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=200, help="number of kills")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="run,force,sequence,clip,batch,label")
    given = parser.parse_args()
    seen: Counter[tuple[str, str, str]] = Counter()

    def count(*kill: str) -> None:
        seen[kill[0], kill[1], kill[2]] += 1

    with tempfile.TemporaryDirectory() as folder:
        chosen = [name for name in given.only.split(",") if name]
        troubles = kill_all(Path(folder), given.count, given.seed, chosen, on_kill=count)
    for (victim, number, end), times in sorted(seen.items()):
        print(f"{victim:<10} {number:<8} {end:<14} {times:4d}")
    print("\n".join(troubles) or f"{given.count} kills, nothing wrong")
    sys.exit(1 if troubles else 0)


if __name__ == "__main__":
    main()
