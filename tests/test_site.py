"""The pages of the site: links, code, commands, and what is generated from the program."""

from __future__ import annotations

import functools
import importlib
import os
import re
import shlex
from itertools import pairwise
from pathlib import Path

import click
import msgspec
import numpy as np
import pytest
import yaml
from test_architecture import LAYERS

import mssegment
from docs.api import api_pages
from docs.docstrings import fields, prose, summary
from docs.formats import REPORT_FIELDS, formats_page
from docs.registries import manifolds_page, models_page
from docs.settings import settings_page
from mssegment import manifolds, models, records
from mssegment.cli import cli
from mssegment.configuration import KEYS, resolve
from mssegment.documents import DOCUMENTS
from mssegment.errors import ExitStatus
from mssegment.rendering.report_json import report_json
from mssegment.results import Results

ROOT = Path(__file__).parents[1]
PAGES = ["README.md", "CONTRIBUTING.md"]
PAGES += sorted(str(path.relative_to(ROOT)) for path in (ROOT / "docs").rglob("*.md"))
GENERATED_PAGES = {"settings.md", "formats.md", "models.md", "manifolds.md", "contributing.md"}
GENERATED_PAGES |= {"changelog.md", *api_pages()}


def text_of(page: str) -> str:
    return (ROOT / page).read_text(encoding="utf-8")


@pytest.mark.parametrize("page", PAGES, ids=PAGES)
def test_every_link_of_a_page_leads_somewhere(page: str) -> None:
    links = re.findall(r"\]\((?!https?:|#)([^)#]+)", text_of(page))
    built = {f"docs/{name}" for name in GENERATED_PAGES}
    targets = {Path(os.path.normpath(ROOT / Path(page).parent / link)) for link in links}
    missing = [
        str(target)
        for target in targets
        if not target.exists() and str(target.relative_to(ROOT)) not in built
    ]
    assert not missing


@pytest.mark.parametrize("page", PAGES, ids=PAGES)
def test_every_reference_to_the_code_is_there(page: str) -> None:
    names = re.findall(r"\]\[(mssegment[\w.]*)\]", text_of(page))
    missing = [name for name in names if not importable(name)]
    assert not missing


@pytest.mark.parametrize("page", [page for page in PAGES if "```python\n" in text_of(page)])
def test_the_python_of_a_page_runs(page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    blocks = re.findall(r"```python\n(.*?)```", text_of(page), re.DOTALL)
    namespace: dict[str, object] = {}
    for block in blocks:
        exec(compile(block, page, "exec"), namespace)


@pytest.mark.parametrize("page", PAGES, ids=PAGES)
def test_the_commands_of_a_page_exist(page: str) -> None:
    blocks = re.findall(r"```(?:sh|sh run|console)\n(.*?)```", text_of(page), re.DOTALL)
    for line in "\n".join(blocks).replace("\\\n", " ").splitlines():
        for part in line.removeprefix("$ ").split("#")[0].split("|"):
            words = shlex.split(part, posix=True)
            if "mssegment" in words:
                check_command(words[words.index("mssegment") + 1 :])


def check_command(words: list[str]) -> None:
    """That the command, its options and the keys of its ``--set`` exist."""
    if words and words[0] in ("...", "--version", "--help"):
        return
    command = cli.get_command(click.Context(cli), words[0])
    assert command is not None, words[0]
    known = {opt for parameter in command.params for opt in parameter.opts}
    known |= {opt for parameter in command.params for opt in parameter.secondary_opts} | {"--help"}
    assert {word for word in words[1:] if word.startswith("-") and len(word) > 1} <= known
    for option, value in pairwise(words):
        assert option != "--set" or value.partition("=")[0] in KEYS


def test_the_formats_page_has_every_field_of_every_document() -> None:
    page = formats_page()
    for kind in DOCUMENTS.values():
        section = page.split(f"{{#{kind.__name__.lower()}}}")[1].split("\n#")[0]
        rows = re.findall(r"^\| `(\w+)` \| .+ \| .+ \| (\S.*) \|$", section, re.MULTILINE)
        assert [name for name, _ in rows] == [f.encode_name for f in msgspec.structs.fields(kind)]
    assert page.count("{#tracks}") == 1


def test_a_record_that_describes_its_fields_describes_them_all() -> None:
    for kind in vars(records).values():
        if isinstance(kind, type) and issubclass(kind, msgspec.Struct) and fields(kind):
            assert set(fields(kind)) == set(kind.__struct_fields__), kind


def test_the_formats_page_has_every_key_of_the_report() -> None:
    points = np.random.default_rng(0).uniform(0, 100, (20, 2, 2))
    found = mssegment.segment_tracks(points)
    report = Results.of(found.segmentation, resolve([])).report
    assert list(report_json(report)) == list(REPORT_FIELDS)


def test_the_page_of_settings_has_every_key() -> None:
    assert re.findall(r"^\| `([a-z_.]+)`", settings_page(), re.MULTILINE) == list(KEYS)


def test_the_pages_of_the_registries_have_every_member() -> None:
    chosen, further = models_page().split("## Further models")
    assert re.findall(r"^## (.+)$", chosen, re.MULTILINE) == list(models.MODELS)
    assert re.findall(r"^## (.+)$", further, re.MULTILINE) == list(models.EVIDENCE)
    found = re.findall(r"^\| `(.+?)` \|", manifolds_page(), re.MULTILINE)
    assert found == [n for family in manifolds.MANIFOLDS.values() for n in family.examples]


def test_the_api_reference_has_every_module() -> None:
    named = re.findall(r"^::: (.+)$", "\n".join(api_pages().values()), re.MULTILINE)
    package = Path(mssegment.__file__).parent
    files = [path.relative_to(package).with_suffix("").parts for path in package.rglob("*.py")]
    modules = {".".join(("mssegment", *parts)).removesuffix(".__init__") for parts in files}
    left_out = {
        name for name in modules if name.split(".")[1:2] in ([], ["cli"], ["__main__"], ["version"])
    }
    assert sorted(named) == sorted(modules - left_out)


def test_contributing_has_the_layers_of_the_architecture() -> None:
    rows = re.findall(r"^\| \d+ \| ([^|]+) \|", text_of("CONTRIBUTING.md"), re.MULTILINE)
    assert [set(re.findall(r"`(\w+)`", row)) for row in rows] == LAYERS


def test_the_exit_statuses_are_those_of_the_program() -> None:
    rows = re.findall(r"^\| (\d+) \|", text_of("docs/guide/pipes.md"), re.MULTILINE)
    assert [int(row) for row in rows] == [int(status) for status in ExitStatus]


def test_docstrings_in_numpydoc_form_are_read() -> None:
    def documented() -> None:
        """One line.

        More of it.

        Parameters
        ----------
        a, b : ndarray [n, 2]
            Two
            lines.
        c
            No type.

        Returns
        -------
        int
            Not a field.
        """

    assert summary(documented) == "One line."
    assert prose(documented) == "One line.\n\nMore of it."
    both = ("Two lines.", "ndarray [n, 2]")
    assert fields(documented) == {"a": both, "b": both, "c": ("No type.", "")}


def importable(name: str) -> bool:
    """Whether a dotted name is a module, or something inside one."""
    parts = name.split(".")
    for end in range(len(parts), 0, -1):
        try:
            thing: object = importlib.import_module(".".join(parts[:end]))
        except ModuleNotFoundError:
            continue
        return (
            functools.reduce(lambda t, part: getattr(t, part, None), parts[end:], thing) is not None
        )
    return False


def test_members_of_the_reference_are_names_whatever_they_are_called() -> None:
    for page in api_pages().values():
        for members in re.findall(r"^      (members: \[.*\])$", page, flags=re.MULTILINE):
            assert all(isinstance(name, str) for name in yaml.safe_load(members)["members"]), (
                members
            )
