"""``compare``, ``benchmark`` and ``label`` as a user meets them."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from mssegment.cli import invoke
from mssegment.configuration import from_file, from_text, resolve
from mssegment.documents import write_document
from mssegment.errors import ExitStatus
from mssegment.pipeline import run

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def two(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """The segmentations of two seeds of the affine sample."""
    folder = tmp_path_factory.mktemp("compare")
    settings = from_file(str(ROOT / "configs" / "affine.yaml"))
    paths = [str(folder / f"{seed}.json") for seed in (1, 2)]
    for seed, path in enumerate(paths, 1):
        found = run(resolve([*settings, *from_text([f"seed={seed}"])]))
        write_document(path, found.segmentation)
    return paths


def test_compare_gives_a_row_per_segmentation(two, capfd) -> None:
    assert invoke(["compare", *two, "--json", "-q"]) == 0
    out = capfd.readouterr().out
    rows = json.loads(out)
    assert all(path in out for path in two)
    assert len(rows["segmentations"] if isinstance(rows, dict) else rows) == 2


def test_a_segmentation_does_not_differ_from_itself(two, capfd) -> None:
    assert invoke(["compare", two[0], two[0], "--json", "-q"]) == 0
    once = json.loads(capfd.readouterr().out)
    rows = once["segmentations"] if isinstance(once, dict) else once
    assert {key: value for key, value in rows[0].items() if "differ" not in key} == {
        key: value for key, value in rows[1].items() if "differ" not in key
    }


@pytest.mark.parametrize("suffix", ["png", "svg"])
def test_compare_draws_them_side_by_side(two, suffix: str, tmp_path: Path, capfd) -> None:
    picture = tmp_path / f"both.{suffix}"
    assert invoke(["compare", *two, "--picture", str(picture), "-q"]) == 0
    capfd.readouterr()
    start = picture.read_bytes()[:400]
    assert start.startswith(b"\x89PNG") if suffix == "png" else b"<svg" in start


def test_compare_says_what_it_misses(two, tmp_path: Path, capfd) -> None:
    assert invoke(["compare", two[0]]) == ExitStatus.USAGE
    assert "two or more" in capfd.readouterr().err
    assert invoke(["compare", *two, "--picture", str(tmp_path / "both.doc")]) == ExitStatus.USAGE
    assert ".png" in capfd.readouterr().err
    assert invoke(["compare", two[0], str(tmp_path / "no.json")]) == ExitStatus.DATA
    assert "no.json" in capfd.readouterr().err


def test_benchmark_prints_json_that_adds_up(data_folder: Path, tmp_path: Path, capfd) -> None:
    sequence = "kanatani2"
    shutil.copytree(data_folder / "hopkins155" / sequence, tmp_path / sequence)
    arguments = ["benchmark", "hopkins155", str(tmp_path), "--motions", "given", "--seeds", "2"]
    assert invoke([*arguments, "--json", "-q"]) == 0
    found = json.loads(capfd.readouterr().out)
    errors = [entry["error"] for entry in found["sequences"]]
    assert [entry["name"] for entry in found["sequences"]] == [sequence] * 2
    assert found["groups"]["all"]["mean"] == pytest.approx(sum(errors) / 2)
    assert found["groups"]["all"]["count_right"] == 1.0


def test_benchmark_of_a_folder_without_the_data_set_says_so(tmp_path: Path, capfd) -> None:
    assert invoke(["benchmark", "hopkins155", str(tmp_path)]) == ExitStatus.DATA
    assert str(tmp_path) in capfd.readouterr().err


def test_label_of_no_pictures_is_a_usage_error(tmp_path: Path, capfd) -> None:
    status = invoke(["label", "--out", str(tmp_path / "labels")])
    assert status in (ExitStatus.USAGE, ExitStatus.DATA)
    assert not (tmp_path / "labels").exists()
    assert capfd.readouterr().err.strip()
