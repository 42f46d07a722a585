"""Kills at random moments, as ``benchmarks.kills`` does them by the hundred."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.kills import kill_all


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc")
def test_a_kill_breaks_nothing_and_the_same_command_completes_it(tmp_path: Path) -> None:
    ends: list[str] = []
    chosen = ["force", "batch"]
    troubles = kill_all(
        tmp_path, 2, 1, chosen, quick=True, on_kill=lambda name, number, end: ends.append(end)
    )
    assert not troubles
    assert len(ends) == 2
