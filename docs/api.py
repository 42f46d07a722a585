"""The API reference: one page for each package, which mkdocstrings fills."""

from __future__ import annotations

import ast
import types
from pathlib import Path

import mssegment
from docs.docstrings import summary

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "mssegment"

PUBLIC = (
    "api",
    "result",
    "manifolds",
    "meanshift",
    "models",
    "geometry",
    "sampling",
    "preprocessing",
    "segmentation",
    "imaging",
    "datasets",
    "documents",
    "configuration",
    "records",
    "errors",
    "evaluation",
    "ground_truth",
    "pipeline",
)
"""What a program may import, in the order of the reference; other packages are internal."""
LEFT_OUT = ("cli", "version")
"""The commands have a page of their own."""


def api_pages() -> dict[str, str]:
    """The API reference: path in the site -> Markdown, the overview first."""
    found = {path.stem for path in PACKAGE.iterdir() if _is_module(path)}
    public = [name for name in PUBLIC if name in found]
    internal = sorted(found - {*PUBLIC, *LEFT_OUT})
    overview = [_overview(), "## Packages\n", *map(_entry, public)]
    overview += ["\n## Internal\n", *map(_entry, internal)]
    pages = {"api/index.md": "\n".join(overview) + "\n"}
    return pages | {f"api/{name}.md": _page(name) for name in [*public, *internal]}


def source_of(module: str) -> ast.Module:
    """The syntax tree of a module, for example ``mssegment.manifolds``."""
    path = ROOT.joinpath(*module.split("."))
    path = path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
    return ast.parse(path.read_text(encoding="utf-8"))


def is_text(item: ast.stmt | None) -> bool:
    """Whether a statement is a string: the docstring of the attribute above it."""
    return (
        isinstance(item, ast.Expr)
        and isinstance(item.value, ast.Constant)
        and isinstance(item.value.value, str)
    )


def _overview() -> str:
    rows = []
    for name in mssegment.__all__:
        thing = getattr(mssegment, name)
        if isinstance(thing, type | types.FunctionType):
            place = f"{thing.__module__}.{thing.__qualname__}"
            rows.append(f"| [`{name}`][{place}] | {summary(thing)} |\n")
    head = "# API reference\n\n`import mssegment` gives:\n\n| name | what it is |\n|---|---|\n"
    return head + "".join(rows)


def _entry(name: str) -> str:
    text = ast.get_docstring(source_of(f"mssegment.{name}")) or ""
    first = " ".join(text.split("\n\n")[0].split())
    return f"- [`mssegment.{name}`]({name}.md): {first}"


def _page(name: str) -> str:
    folder = PACKAGE / name
    paths = folder.rglob("*.py") if folder.is_dir() else [PACKAGE / f"{name}.py"]
    modules = sorted(map(_dotted, filter(_is_public, paths)))
    return "\n".join(_directive(module, 1 if i == 0 else 2) for i, module in enumerate(modules))


def _is_module(path: Path) -> bool:
    return (path / "__init__.py").exists() or (path.suffix == ".py" and path.name[0] != "_")


def _is_public(path: Path) -> bool:
    return path.name == "__init__.py" or not path.name.startswith("_")


def _dotted(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _directive(module: str, level: int) -> str:
    """The directive of mkdocstrings for what a module itself defines."""
    # quoted: a class named Null, On or Yes is no name in YAML
    members = ", ".join(f'"{name}"' for name in _members(source_of(module)))
    return f"::: {module}\n    options:\n      heading_level: {level}\n      members: [{members}]\n"


def _members(tree: ast.Module) -> list[str]:
    """The public names that a module defines and documents, in its order."""
    names = []
    for item, following in zip(tree.body, [*tree.body[1:], None], strict=True):
        if isinstance(item, ast.FunctionDef | ast.ClassDef):
            names.append(item.name)
        elif isinstance(item, ast.Assign | ast.AnnAssign) and is_text(following):
            target = item.targets[0] if isinstance(item, ast.Assign) else item.target
            names += [target.id] if isinstance(target, ast.Name) else []
    return [name for name in names if not name.startswith("_")]
