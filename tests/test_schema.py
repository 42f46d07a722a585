"""JSON Schemas: what the program writes is valid by them, and what it refuses is not."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml

from docs.formats import REPORT_FIELDS
from mssegment.cli import invoke
from mssegment.cli.schema import NAMES as OFFERED
from mssegment.configuration.template import template
from mssegment.schema import NAMES, REPORT, json_schema

SAMPLE = Path(__file__).parents[1] / "sample_data" / "affine"


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("schema") / "out"
    images = [str(SAMPLE / f"frame-{i}.png") for i in (1, 2)]
    labels = ["--labels", str(SAMPLE / "mask-*.png"), "--set", "report.html=no"]
    assert invoke(["run", *images, *labels, "--out", str(out), "-q"]) == 0
    return out


def valid(name: str, value: Any) -> bool:
    jsonschema = pytest.importorskip("jsonschema")
    validator = jsonschema.Draft202012Validator
    validator.check_schema(json_schema(name))
    return bool(validator(json_schema(name)).is_valid(value))


@pytest.mark.parametrize("name", [name for name in NAMES if name != "configuration"])
def test_what_is_written_is_valid(results: Path, name: str) -> None:
    written = json.loads((results / f"{name}.json").read_text())
    assert valid(name, written)
    assert not valid(name, written | {"schema": "mssegment/other/1"})
    assert not valid(name, {key: written[key] for key in written if key != "frames"})


def test_the_configuration_is_valid_and_unknown_keys_are_not() -> None:
    written = yaml.safe_load(template())
    assert valid("configuration", written)
    assert not valid("configuration", written | {"detekt": {}})
    assert not valid("configuration", written | {"segment": {"motion": 2}})
    assert not valid("configuration", written | {"seed": -1})


def test_the_command_writes_each_schema(capfd: pytest.CaptureFixture[str]) -> None:
    assert OFFERED == NAMES
    for name in NAMES:
        assert invoke(["schema", name]) == 0
        assert json.loads(capfd.readouterr().out) == json.loads(json.dumps(json_schema(name)))


def test_the_keys_of_the_report_are_documented() -> None:
    assert set(REPORT) <= set(REPORT_FIELDS)
