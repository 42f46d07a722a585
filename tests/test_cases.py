"""The runner of cases: what happened is said for every way in which a process can end."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.cases import cases_of, run_case

KINDS = {
    "right": ("mssegment run m.csv --out out --format text", "1 motion", "1 motion", []),
    "refused": ("mssegment run none.csv", "refused", "exit 4: none.csv: no such file", []),
    "killed": ("kill -ABRT $$", "survives", "killed by SIGABRT", ["crash"]),
    "bug": ("python -c 'raise ValueError(3)'", "no bug", "exit 1: ValueError: 3", ["crash"]),
    "wrong": ("mssegment run m.csv --format text", "3 motions", "1 motion", ["expected 3 motions"]),
    "writes": ("touch mine; ls mine", "mine", "mine", []),
}


@pytest.mark.parametrize("kind", KINDS)
def test_every_end_of_a_case_is_told(tmp_path: Path, kind: str) -> None:
    command, expect, happened, faults = KINDS[kind]
    case = tmp_path / f"1-{kind}"
    case.mkdir()
    (case / "cmd").write_text(command)
    (case / "expect").write_text(expect)
    if "m.csv" in command:
        rows = [f"{x},{y},{x + 9},{y + 5}" for x in range(0, 300, 40) for y in range(0, 200, 30)]
        (case / "m.csv").write_text("\n".join(["x1,y1,x2,y2", *rows]))
    outcome = run_case(case)
    assert outcome.happened.startswith(happened)
    assert [fault for fault in outcome.faults if fault in faults] == faults
    assert bool(outcome.faults) == bool(faults)
    assert not (case / "mine").exists(), "the case itself is left as it was"


def test_cases_of_attacks_are_left_out(tmp_path: Path) -> None:
    for name in ("10-a", "hostile", "2-b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "cmd").touch()
    assert [case.name for case in cases_of(tmp_path)] == ["10-a", "2-b"]
    assert [case.name for case in cases_of(tmp_path, ["2"])] == ["2-b"]
