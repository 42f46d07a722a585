"""What a command loads, and what it leaves alone: starting takes as long as a part of the work."""

from __future__ import annotations

import platform
import subprocess
import sys
from pathlib import Path

import pytest

SAMPLE = Path(__file__).parents[1] / "sample_data" / "affine"
PAIR = [str(SAMPLE / "frame-1.png"), str(SAMPLE / "frame-2.png")]
NO_PICTURES = ["--set", "report.pictures=no", "--set", "report.html=no", "--quiet"]
SLOW = {"yaml", "scipy", "numpy.ma", "dataclasses", "tempfile", "json", "csv"}
"""Modules that take long to load, or to use, and that a run on two pictures has no need of."""


def python(code: str, *arguments: str) -> str:
    """What this code prints in a Python of its own."""
    command = [sys.executable, "-c", code, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def loaded(*arguments: str) -> set[str]:
    """The modules that a command has loaded when it is done."""
    code = "import sys, mssegment.cli as c; c.invoke(sys.argv[1:]); print(); print(*sys.modules)"
    return set(python(code, *arguments).splitlines()[-1].split())


@pytest.fixture(scope="module")
def slow() -> set[str]:
    """The slow modules that our packages do not load themselves, as old NumPy and msgspec do."""
    return SLOW - set(python("import numpy, cv2, msgspec, sys; print(*sys.modules)").split())


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, set[str]]:
    """The folder of results of a run on two pictures, and what it has loaded."""
    out = tmp_path_factory.mktemp("out")
    return out, loaded(
        "run", *PAIR, "--model", "affine", "--out", str(out), "--force", *NO_PICTURES
    )


def test_two_pictures_load_nothing_slow(run: tuple[Path, set[str]], slow: set[str]) -> None:
    assert not run[1] & slow


def test_two_pictures_load_no_other_way_to_motions(run: tuple[Path, set[str]]) -> None:
    others = {
        "segmentation.consensus",
        "segmentation.mixture",
        "preprocessing.rotation_compensation",
    }
    others |= {"ground_truth", "datasets", "rendering.pictures", "rendering.page", "api"}
    others |= {"cli.detect", "cli.match", "cli.hypothesize", "cli.cluster"}
    assert not run[1] & {f"mssegment.{name}" for name in others}


def test_tables_load_no_pictures_and_no_mathematics(
    run: tuple[Path, set[str]], slow: set[str]
) -> None:
    found = loaded("report", str(run[0] / "segmentation.json"), "--format", "text")
    assert not found & (slow | {"cv2", "mssegment.imaging.frames", "mssegment.manifolds"})


def test_labels_are_compared_without_scipy(run: tuple[Path, set[str]], slow: set[str]) -> None:
    masks = str(SAMPLE / "mask-*.png")
    found = loaded("report", str(run[0] / "segmentation.json"), "--labels", masks)
    assert not found & slow & {"scipy", "numpy.ma"}


@pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="only glibc is taught")
def test_memory_is_kept_for_the_next_array() -> None:
    code = """
import resource, numpy
from mssegment.resources import keep_freed_memory
keep_freed_memory()
def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt
numpy.ones(2**20)
before = faults()
for _ in range(20):
    numpy.ones(2**20)
print(faults() - before)
"""
    assert int(python(code)) < 2 * 2**23 / 4096  # once is 2048 pages
