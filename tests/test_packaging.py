"""The distribution: complete, the same bytes each time, and the installed wheel works."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import pytest
import yaml

import mssegment

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


THEIR_PROJECT = """
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "their-package"
version = "1.0"

[tool.hatch.build.targets.wheel]
only-include = ["their_package.py"]

[project.entry-points."mssegment.manifolds"]
hyperbolic = "their_package:Hyperbolic"

[project.entry-points."mssegment.models"]
displacement = "their_package:Displacement"

[project.entry-points."mssegment.matchers"]
nearest = "their_package:NEAREST"
"""
"""A package with the examples of docs/extending.md."""


def tracked() -> list[str]:
    """The files of the repository; skips where this is no clone."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a git clone, so nothing says which files belong to it")
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return [name for name in listed.stdout.split("\0") if name and (ROOT / name).exists()]


def build(folder: Path, epoch: int, umask: int) -> Path:
    """Copies the sources into a folder, with times and rights of their own, and builds them."""
    source = folder / "source"
    for name in tracked():
        target = source / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(ROOT / name, target)
        target.chmod(0o666 & ~umask)
        os.utime(target, (epoch, epoch))
    subprocess.run(
        [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(folder / "dist")],
        cwd=source,
        env=os.environ | {"SOURCE_DATE_EPOCH": "1700000000"},
        capture_output=True,
        text=True,
        check=True,
        umask=umask,
    )
    return folder / "dist"


@pytest.fixture(scope="module")
def distributions(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    for package in ("build", "hatchling"):
        pytest.importorskip(
            package, reason=f"{package} is not installed: make test EXTRAS=dev,dist"
        )
    return [
        build(tmp_path_factory.mktemp("first"), epoch=1_600_000_000, umask=0o022),
        build(tmp_path_factory.mktemp("second-copy"), epoch=1_650_000_000, umask=0o077),
    ]


def only(folder: Path, pattern: str) -> Path:
    (found,) = folder.glob(pattern)
    return found


@pytest.mark.parametrize("pattern", ["*.tar.gz", "*.whl"])
def test_the_same_sources_give_the_same_bytes(distributions: list[Path], pattern: str) -> None:
    first, second = (only(folder, pattern) for folder in distributions)
    assert first.name == second.name
    assert first.read_bytes() == second.read_bytes()


def test_the_sdist_has_every_file_of_the_repository(distributions: list[Path]) -> None:
    with tarfile.open(only(distributions[0], "*.tar.gz")) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert names == {*tracked(), "PKG-INFO"}


def test_the_installed_wheel_segments_the_sample(distributions: list[Path], tmp_path: Path) -> None:
    wheel, target = only(distributions[0], "*.whl"), tmp_path / "site"
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([*pip, "--target", str(target), str(wheel)], check=True)
    sample = ROOT / "sample_data" / "affine"
    pictures = [str(sample / f"frame-{i}.png") for i in (1, 2)]
    run = subprocess.run(
        [sys.executable, str(target / "bin" / "mssegment"), "run", *pictures, "--out", "out"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(target)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert '"motions":3' in run.stdout.replace(" ", "")
    assert (tmp_path / "out" / "report.html").stat().st_size > 10_000


def test_a_wheel_of_another_package_adds_its_own(distributions: list[Path], tmp_path: Path) -> None:
    """Built and installed beside the wheel of this one, without any change of it."""
    source, target = tmp_path / "source", tmp_path / "site"
    source.mkdir()
    page = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", page, re.S)
    code = [block for block in blocks if "class " in block or "def match" in block]
    (source / "their_package.py").write_text("\n\n".join(code), encoding="utf-8")
    (source / "pyproject.toml").write_text(THEIR_PROJECT, encoding="utf-8")
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", "dist"]
    subprocess.run(command, cwd=source, check=True, capture_output=True)
    wheels = [only(distributions[0], "*.whl"), only(source / "dist", "*.whl")]
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([*pip, "--target", str(target), *map(str, wheels)], check=True)
    code = [
        "from mssegment.manifolds import from_name",
        "from mssegment.models import make",
        "from mssegment.imaging.matching import MATCHERS",
        "print(from_name('hyperbolic(2)').dim, make('displacement').name, 'nearest' in MATCHERS)",
    ]
    run = subprocess.run(
        [sys.executable, "-c", "; ".join(code)],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(target)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout.split() == ["2", "displacement", "True"]


def test_the_citation_is_of_this_version() -> None:
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["cff-version"] == "1.2.0"
    assert citation["message"]
    assert citation["title"] == PROJECT["name"]
    assert citation["version"] == mssegment.__version__
    assert citation["license"] == PROJECT["license"]
    assert citation["authors"] == [{"name": "The mssegment authors"}]
    paper = citation["preferred-citation"]
    assert [author["family-names"] for author in paper["authors"]] == ["Subbarao", "Meer"]
    assert (paper["year"], paper["start"], paper["end"]) == (2006, 1168, 1175)


def test_the_extra_for_development_stays_light() -> None:
    names = {re.split(r"[\[<>=]", need)[0] for need in PROJECT["optional-dependencies"]["dev"]}
    assert names == {
        "pytest",
        "pytest-cov",
        "pytest-xdist",
        "hypothesis",
        "ruff",
        "mypy",
        "types-PyYAML",
    }
