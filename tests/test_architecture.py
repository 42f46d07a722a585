"""The architecture: imports run one way; the mathematics knows no files and no terminal."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import mssegment
from mssegment.registry import EVIDENCE, MODELS

ROOT = Path(mssegment.__file__).parent
LAYERS = [
    {"records", "errors", "plugins", "registry", "version", "progress"},
    {"blas", "inputs", "neighbours", "resources", "special"},
    {"manifolds", "geometry"},
    {"models", "evaluation"},
    {"meanshift", "imaging", "datasets", "cameras", "annotations", "documents", "configuration"},
    {"preprocessing", "folders"},
    {"sampling"},
    {
        "segmentation",
        "sequences",
        "rendering",
        "labelling",
        "masks",
        "export",
        "ground_truth",
        "history",
        "schema",
    },
    {"stage_checks"},
    {"pipeline"},
    {"results", "clips"},
    {"runs"},
    {"result"},
    {"batch", "benchmarking", "api", "multi_model"},
    {"cli", "__main__"},
]
"""From the bottom up: a package imports only from its own layer or those below."""
LAYER = {package: level for level, packages in enumerate(LAYERS) for package in packages}
TERMINAL = {"click", "rich"}
MATHEMATICS = {
    "evaluation",
    "geometry",
    "manifolds",
    "meanshift",
    "models",
    "preprocessing",
    "sampling",
    "segmentation",
    "sequences",
}
FILES = {"cv2", "pathlib", "os", "io", "json", "yaml", "msgspec", "click", "rich"}


def imports_of(path: Path) -> set[str]:
    """Every module that a file imports, also inside functions and for type checking."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            module = node.module or ""
            found |= {f"{module}.{alias.name}" for alias in node.names} | {module}
    return found


def package_of(path: Path) -> str:
    """The folder or file right below ``mssegment`` that a source file belongs to."""
    return path.relative_to(ROOT).parts[0].removesuffix(".py")


def packages_imported(path: Path) -> set[str]:
    names = (name.split(".") for name in imports_of(path) if name.startswith("mssegment."))
    return {parts[1] for parts in names} & LAYER.keys()


def sources() -> list[Path]:
    return [path for path in ROOT.rglob("*.py") if path != ROOT / "__init__.py"]


def test_every_package_has_its_layer() -> None:
    assert {package_of(path) for path in sources()} <= LAYER.keys()


def test_imports_run_one_way() -> None:
    upwards = [
        f"{path.relative_to(ROOT)} imports {package}"
        for path in sources()
        for package in packages_imported(path)
        if LAYER[package] > LAYER[package_of(path)]
    ]
    assert not upwards


def test_packages_of_one_layer_have_no_circles() -> None:
    edges = {
        (package_of(path), package) for path in sources() for package in packages_imported(path)
    }
    edges = {(a, b) for a, b in edges if a != b}
    both_ways = [(a, b) for a, b in edges if (b, a) in edges]
    assert not both_ways


def test_only_the_command_line_knows_the_terminal() -> None:
    knows = [
        str(path.relative_to(ROOT))
        for path in sources()
        if package_of(path) != "cli"
        and {name.split(".")[0] for name in imports_of(path)} & TERMINAL
    ]
    assert not knows


def test_the_mathematics_knows_no_files() -> None:
    knows = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in sources()
        if package_of(path) in MATHEMATICS
        for name in imports_of(path)
        if name.split(".")[0] in FILES
    ]
    assert not knows


def test_help_imports_no_command_and_no_numbers() -> None:
    code = "import sys, mssegment.cli as c; c.invoke(['--help']); print(*sys.modules)"
    process = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    loaded = set(process.stdout.splitlines()[-1].split())
    assert not loaded & {"numpy", "cv2", "scipy", "msgspec", "yaml", "rich", "mssegment.cli.run"}


FORBIDDEN = {
    "manifolds": {"scipy", "cv2"},
    "geometry": {"mssegment.models", "mssegment.manifolds", "scipy", "cv2"},
    "models": {"mssegment.sampling", "mssegment.segmentation", "mssegment.meanshift"},
    "meanshift": {"mssegment.models", "mssegment.segmentation"},
    "sampling": {"mssegment.segmentation", "mssegment.meanshift"},
    "rendering": {"mssegment.segmentation", "mssegment.sampling"},
}
"""Package -> what it must not import, beyond the order of the layers."""


@pytest.mark.parametrize("package", FORBIDDEN)
def test_packages_leave_alone_what_they_do_not_need(package: str) -> None:
    knows = [
        f"{path.relative_to(ROOT)}: {name}"
        for path in (ROOT / package).rglob("*.py")
        for name in imports_of(path)
        if any(name == each or name.startswith(f"{each}.") for each in FORBIDDEN[package])
    ]
    assert not knows


def test_only_one_strategy_is_loaded_for_two_views() -> None:
    """``segmentation`` decides by the strategy alone, and loads no other one."""
    source = (ROOT / "segmentation" / "__init__.py").read_text()
    eager = source.split("def cluster(")[0]
    assert "consensus" not in eager.replace('"consensus"', "")
    assert "mixture" not in eager.replace('"mixture"', "")


@pytest.mark.parametrize("name", [*MODELS, *EVIDENCE])
def test_no_code_asks_for_the_name_of_a_model(name: str) -> None:
    """Models differ by their traits: no comparison with a model's name outside its own file."""
    asks = [
        f"{path.relative_to(ROOT)}:{node.lineno}"
        for path in sources()
        if path.stem != name
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Compare)
        and any(isinstance(side, ast.Constant) and side.value == name for side in ast.walk(node))
    ]
    assert not asks


@pytest.mark.parametrize(
    ("formula", "home"),
    [
        ("def sampson", "geometry/epipolar.py"),
        ("def transfer", "geometry/projective.py"),
        ("def damped_step", "geometry/levenberg_marquardt.py"),
        ("cholesky", "geometry/robust.py"),
        ("def geman_mcclure", "geometry/robust.py"),
    ],
)
def test_each_formula_stands_once(formula: str, home: str) -> None:
    where = {str(path.relative_to(ROOT)) for path in sources() if formula in path.read_text()} - {
        "manifolds/base.py"
    }
    assert where == {home}
