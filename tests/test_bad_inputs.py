"""Every bad input ends with one line that names it, soon, within 1 GB, and leaves nothing."""

from __future__ import annotations

import os
import resource
import shutil
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from benchmarks.fuzz_files import whole_files
from mssegment.cli import LONGEST_ERROR, invoke
from tests.bad_inputs import TABLE, Bad

CPU_SECONDS = 5.0
MEMORY = 2**30


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with whole files of every kind."""
    folder = tmp_path_factory.mktemp("whole")
    here = Path.cwd()
    os.chdir(folder)
    try:
        whole_files(folder)
    finally:
        os.chdir(here)
    return folder


@pytest.fixture
def within_memory() -> Iterator[None]:
    """What is allocated beyond 1 GB fails."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    resource.setrlimit(resource.RLIMIT_AS, (pages * os.sysconf("SC_PAGESIZE") + MEMORY, hard))
    yield
    resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def test_the_table_is_long_enough_and_every_row_has_its_own_name() -> None:
    assert len(TABLE) >= 250
    assert len({row.name for row in TABLE}) == len(TABLE)


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="measures memory as Linux does")
@pytest.mark.parametrize("bad", TABLE, ids=[row.name for row in TABLE])
def test_bad_input(
    bad: Bad,
    whole: Path,
    within_memory: None,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
) -> None:
    for file in whole.iterdir():
        os.link(file, tmp_path / file.name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("mssegment.inputs.files._PATIENCE", 0.05)
    bad.make()
    before = sorted(tmp_path.rglob("*"))
    start = time.process_time()
    status = invoke(list(bad.arguments))
    seconds = time.process_time() - start
    out, err = capfd.readouterr()
    lines = err.splitlines()
    assert status in bad.status, err
    errors = [line for line in lines if line.startswith("mssegment: ")]
    assert len(errors) == 1, err
    assert lines[-1] == errors[0]
    assert errors[0].isprintable()
    assert len(errors[0]) <= LONGEST_ERROR + len("mssegment: ")
    for word in bad.words:
        assert word in errors[0]
    assert not out
    assert sorted(tmp_path.rglob("*")) == before
    assert seconds < CPU_SECONDS
    shutil.rmtree(tmp_path, ignore_errors=True)
