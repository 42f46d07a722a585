"""The same input, seed and versions give the same bytes, whatever the number of BLAS threads."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from benchmarks import kernels
from mssegment import blas

ROOT = Path(__file__).parents[1]
# numpy is imported first, as in a user's program: only then has its BLAS several threads
LIBRARY = """
import hashlib, sys
import numpy as np
import mssegment
from mssegment import blas, documents
rng = np.random.default_rng(0)
time = np.arange(12)[:, None]
first = rng.uniform(0, 500, (400, 1, 2)) + time * [3, 1]
second = rng.uniform(0, 500, (400, 1, 2)) - time * [2, 1]
points = np.concatenate([first, second]) + rng.normal(0, 0.3, (800, 12, 2))
found = mssegment.segment_tracks(points, {"cluster.method": "meanshift"})
print(max(library.get() for library in blas._loaded().values()))
print(hashlib.sha256(documents.encode(found.segmentation)).hexdigest())
"""
COMMAND = "import sys; from mssegment.cli import main; main(sys.argv[1:])"


def output(code: str, *arguments: str, **variables: str) -> bytes:
    environment = {**os.environ, "PYTHONPATH": str(ROOT), **variables}
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, env=environment, check=True, stdout=subprocess.PIPE).stdout


def threads(count: int) -> dict[str, str]:
    return dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), str(count))


@pytest.mark.skipif(not blas._loaded(), reason="no OpenBLAS in a wheel")
@pytest.mark.skipif((os.cpu_count() or 1) < 2, reason="one processor")
def test_the_library_with_one_and_with_two_threads() -> None:
    one = output(LIBRARY, **threads(1)).split()
    two = output(LIBRARY, **threads(2), PYTHONHASHSEED="7", TZ="Asia/Kolkata").split()
    assert one[0] == b"1"
    assert two[0] == b"2", "afterwards the user has his threads again"
    assert one[1] == two[1]


def test_the_command_line_in_another_environment(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    first = rng.uniform(0, 400, (120, 2))
    second = np.where(np.arange(120)[:, None] < 60, first + 9, 1.05 * first - 20)
    rows = np.concatenate([first, second], axis=1)
    np.savetxt(tmp_path / "m.csv", rows, delimiter=",", header="x1,y1,x2,y2", comments="")
    arguments = ["run", str(tmp_path / "m.csv"), "--force", "--quiet", "--format", "json"]
    arguments += ["--set", "report.pictures=no", "--set", "report.html=no", "--out"]
    found = []
    for name, variables in {
        "plain": {"LC_ALL": "C", "PYTHONHASHSEED": "0", "TZ": "UTC", **threads(1)},
        "other": {"LC_ALL": "C.UTF-8", "PYTHONHASHSEED": "5", "TZ": "Asia/Tokyo", **threads(4)},
    }.items():
        extra = ["--threads", "2"] if name == "other" else []
        output(COMMAND, *arguments, str(tmp_path / name), *extra, **variables)
        found.append(
            {p.name: p.read_bytes() for p in (tmp_path / name).iterdir() if p.suffix == ".json"}
        )
        found[-1].pop("timings.json")
    assert found[0] == found[1]
    assert len(found[0]) >= 4


@pytest.mark.skipif(not blas._loaded(), reason="no OpenBLAS in a wheel")
def test_one_thread_is_nested_and_concurrent() -> None:
    libraries = blas._loaded().values()
    before = [library.get() for library in libraries]
    try:
        for library in libraries:
            library.set(2)
        inside: list[int] = []
        ready, done = threading.Barrier(2), threading.Barrier(2)

        def other() -> None:
            with blas.one_thread():
                ready.wait(10)
                done.wait(10)  # the main thread has left its block
                inside.extend(library.get() for library in libraries)

        thread = threading.Thread(target=other)
        with blas.one_thread(), blas.one_thread():
            thread.start()
            ready.wait(10)
            assert os.environ["OPENBLAS_NUM_THREADS"] == "1"
        done.wait(10)
        thread.join()
        assert set(inside) == {1}
        assert [library.get() for library in libraries] == [2] * len(before)
    finally:
        for library, count in zip(libraries, before, strict=True):
            library.set(count)


def test_one_thread_ends_with_an_error() -> None:
    before = {name: os.environ.get(name) for name in blas._VARIABLES}
    counts = {path: library.get() for path, library in blas._loaded().items()}

    def fail() -> None:
        raise ValueError("inside")

    with pytest.raises(ValueError, match="inside"):
        blas.with_one_thread(fail)()
    assert {name: os.environ.get(name) for name in blas._VARIABLES} == before
    assert {path: library.get() for path, library in blas._loaded().items()} == counts


PRODUCTS = """
import numpy as np
for n in (1, 10, 100, 1000):
    for k in (1, 3, 9, 81):
        a = np.ones((20, n, k))
        a[0].T @ a[0], a[0] @ a[0].T, np.ones((k, n)) @ a[0], a.swapaxes(1, 2) @ a
"""


def multiplies(kernel: str) -> bool:
    """Whether numpy alone survives the kernel: OpenBLAS 0.3.34 crashes with some if forced."""
    environment = {**os.environ, "OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", PRODUCTS]
    return subprocess.run(command, env=environment, check=False).returncode == 0


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="kernels of x86-64")
@pytest.mark.skipif(not blas._loaded(), reason="no OpenBLAS in a wheel")
def test_labels_do_not_hang_on_the_kernel_of_the_cpu() -> None:
    pair = ("Haswell", "Nehalem")
    crashing = [name for name in pair if not multiplies(name)]
    if crashing:
        pytest.skip(f"numpy's own matrix products crash with the kernels {', '.join(crashing)}")
    first, second = (kernels.with_kernel(name, kernels.SAMPLES) for name in pair)
    for name in kernels.SAMPLES:
        assert kernels.agreement(first[name], second[name]) >= 0.99, name
