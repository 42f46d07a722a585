"""The examples of docs/extending.md, as a package of somebody else: entry points and all laws."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "extending.md").read_text()
ENTRY_POINTS = """\
[mssegment.manifolds]
hyperbolic = their_package:Hyperbolic
euclidean = their_package:Hyperbolic

[mssegment.models]
displacement = their_package:Displacement

[mssegment.matchers]
nearest = their_package:NEAREST
affine = their_package:NEAREST
"""


def blocks() -> list[str]:
    return re.findall(r"```python\n(.*?)```", PAGE, re.S)


@pytest.fixture(scope="module")
def environment(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """An environment in which the package is installed as pip would install it."""
    folder = tmp_path_factory.mktemp("site")
    code = [block for block in blocks() if "class " in block or "def match" in block]
    (folder / "their_package.py").write_text("\n\n".join(code))
    info = folder / "their_package-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: their-package\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    path = os.pathsep.join([str(folder), str(ROOT), os.environ.get("PYTHONPATH", "")])
    return {**os.environ, "PYTHONPATH": path}


def python(environment: dict[str, str], *arguments: str, text: str | None = None) -> str:
    done = subprocess.run(
        [sys.executable, *arguments],
        env=environment,
        input=text,
        capture_output=True,
        text=True,
        cwd=ROOT,
        check=False,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return done.stdout


def test_the_classes_are_shorter_than_60_lines() -> None:
    lengths = [len(block.splitlines()) for block in blocks() if "class " in block]
    assert len(lengths) == 2
    assert max(lengths) < 60


def test_the_page_runs(environment: dict[str, str]) -> None:
    python(environment, "-c", "\n".join(blocks()))


def test_names_of_other_packages_are_known_and_replace_none(environment: dict[str, str]) -> None:
    code = (
        "from mssegment.manifolds import from_name; from mssegment.registry import MODELS; "
        "print(from_name('hyperbolic(3)').dim, type(from_name('euclidean(2)')).__name__, "
        "list(MODELS)[-1])"
    )
    assert python(environment, "-c", code).split() == ["3", "Euclidean", "displacement"]


def test_matchers_of_other_packages(environment: dict[str, str]) -> None:
    code = (
        "import numpy as np; from mssegment.imaging.matching import MATCHERS, match; "
        "from mssegment.records import Corners; from mssegment.configuration import KEYS; "
        "one = np.array([[1.0, 2.0], [50.0, 60.0]]); n = np.ones(2); "
        "found = match([np.zeros((9, 9), np.float32)] * 2, [Corners(one, n, n), "
        "Corners(one[::-1] + 1, n, n)], 'nearest'); "
        "print(list(MATCHERS)[-1], MATCHERS['affine'].module, found.points[0, 1].tolist(), "
        "'nearest' in KEYS['match.method'].choices, sep=';')"
    )
    own = "mssegment.imaging.matching.affine"
    assert python(environment, "-c", code).strip() == f"nearest;{own};[2.0, 3.0];True"


def test_all_laws_hold_for_the_manifold(environment: dict[str, str]) -> None:
    python(
        environment,
        "-m",
        "pytest",
        "-q",
        "-k",
        "hyperbolic",
        "tests/test_manifolds.py",
        "-p",
        "no:cacheprovider",
    )


def test_all_laws_hold_for_the_model(environment: dict[str, str]) -> None:
    python(
        environment,
        "-m",
        "pytest",
        "-q",
        "-k",
        "displacement",
        "tests/test_models.py",
        "-p",
        "no:cacheprovider",
    )


def test_the_command_line_takes_both(environment: dict[str, str], tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    first = rng.uniform(0.0, 600.0, (60, 2))
    shift = np.repeat([[30.0, 5.0], [-20.0, 12.0]], 30, axis=0)
    table = np.column_stack([first, first + shift + rng.normal(0.0, 0.2, (60, 2))])
    np.savetxt(tmp_path / "matches.csv", table, delimiter=",", fmt="%.3f")
    main = "from mssegment.cli import main; main()"
    tracks = python(environment, "-c", main, "import", str(tmp_path / "matches.csv"), "-q")
    found = python(
        environment, "-c", main, "hypothesize", "--model", "displacement", "-q", text=tracks
    )
    out = python(environment, "-c", main, "cluster", "-q", text=found)
    assert '"displacement"' in out
    points = np.column_stack([np.ones(30), np.zeros(30), np.zeros(30)])
    points[:, 1:] = 0.01 * rng.standard_normal((30, 2))
    np.savetxt(tmp_path / "points.csv", points, delimiter=",", fmt="%.6f")
    fused = python(
        environment,
        "-c",
        main,
        "fuse",
        str(tmp_path / "points.csv"),
        "-q",
        "--manifold",
        "hyperbolic(2)",
        "--format",
        "csv",
    )
    assert fused.splitlines()[1].startswith("M1,")
