"""Documents edited by hand: every stage reads them, or rejects them in one line."""

from __future__ import annotations

import copy
import io
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from mssegment.cli import invoke
from mssegment.configuration import resolve
from mssegment.documents import HypothesesDocument, decode
from mssegment.errors import DataError
from mssegment.pipeline import cluster
from mssegment.stage_checks import check_sets, nothing_moves

COMMANDS = {"tracks": "hypothesize", "hypotheses": "cluster", "segmentation": "report"}
STATUSES = {0, 2, 3, 4}


def run(*arguments: str, stdin: bytes = b"") -> tuple[int, bytes, str]:
    """Status, standard output and standard error of a command line, in this process."""
    kept = sys.stdin, sys.stdout, sys.stderr
    written, err = io.BytesIO(), io.StringIO()
    sys.stdin, sys.stderr = io.TextIOWrapper(io.BytesIO(stdin)), err
    sys.stdout = io.TextIOWrapper(written, "utf-8")
    try:
        status = invoke(list(arguments))
        sys.stdout.flush()
        return status, written.getvalue(), err.getvalue()
    finally:
        sys.stdin, sys.stdout, sys.stderr = kept


@pytest.fixture(scope="module")
def documents(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """A small document of each stage: two affine motions and a few mismatches."""
    rng = np.random.default_rng(5)
    first = rng.uniform(0, 200, (40, 2)) + np.repeat([[0, 0], [300, 0]], 20, axis=0)
    second = first @ np.array([[0.98, 0.1], [-0.1, 0.98]]) + np.array([20, 5])
    second[20:] = first[20:] @ np.array([[1.05, 0.0], [0.1, 0.95]]) + np.array([-30, 10])
    second += rng.normal(0, 0.3, second.shape)
    second[::10] = rng.uniform(0, 500, (4, 2))
    rows = "\n".join(",".join(f"{x:.3f}" for x in row) for row in np.hstack([first, second]))
    path = tmp_path_factory.mktemp("tracks") / "tracks.csv"
    path.write_text(f"x1,y1,x2,y2\n{rows}\n")
    made = {"tracks": run("import", str(path))[1]}
    made["hypotheses"] = run("hypothesize", "--count", "60", stdin=made["tracks"])[1]
    made["segmentation"] = run("cluster", stdin=made["hypotheses"])[1]
    assert json.loads(made["segmentation"])["motions"]
    return made


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths to all values of a document; only the first three elements of a list."""
    if isinstance(value, dict):
        inside = list(value.items())
    elif isinstance(value, list):
        inside = list(enumerate(value))[:3]
    else:
        return [path]
    return [path] * bool(path) + [p for key, part in inside for p in places(part, (*path, key))]


ODD = st.sampled_from(
    [None, True, -1, 0, 1, 3, 2**40, -0.5, 1e-12, 1e5, 1e300, "", "affine", "x", [], [[]], {}]
) | st.recursive(st.floats(-1e4, 1e4) | st.integers(-3, 50), st.lists, max_leaves=6)


@settings(
    max_examples=200,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
@given(data=st.data())
@pytest.mark.parametrize("kind", COMMANDS)
def test_an_edited_document_is_read_or_rejected_in_one_line(
    kind: str, documents: dict[str, bytes], data: st.DataObject
) -> None:
    content = json.loads(documents[kind])
    for _ in range(data.draw(st.integers(1, 3))):
        path = data.draw(st.sampled_from(places(content)))
        place = content
        for key in path[:-1]:
            place = place[key]
        if data.draw(st.booleans()):
            place[path[-1]] = copy.deepcopy(data.draw(ODD))
        elif isinstance(place, dict):
            del place[path[-1]]
        else:
            place.pop(path[-1])
    changed = json.dumps(content).encode()
    arguments = [COMMANDS[kind], "--quiet", *(["--json"] if kind == "segmentation" else [])]
    status, out, err = run(*arguments, stdin=changed)
    assert status in STATUSES, err
    assert len(err.splitlines()) == (status != 0), err
    assert bool(out) == (status == 0)


Change = Callable[[dict[str, Any]], None]


def change(key: str, value: Any) -> Change:
    def apply(chosen: dict[str, Any]) -> None:
        chosen[key] = value

    return apply


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        (change("model", "torus"), "no model is called 'torus'"),
        (change("model", "homography"), "belongs to manifold special_linear(3); found affine(2)"),
        (change("model", "factorization"), "model factorization does not accept 2 frames"),
        (change("manifold", "torus"), "no manifold is called 'torus'"),
        (
            change("manifold", "grassmann(3,1)"),
            "manifold affine(2); found grassmann(3,1)",
        ),
    ],
)
def test_a_set_must_fit_its_model(
    changed: Change, message: str, documents: dict[str, bytes]
) -> None:
    content = json.loads(documents["hypotheses"])
    changed(content["sets"][0])
    document = decode(json.dumps(content).encode(), HypothesesDocument)
    with pytest.raises(DataError, match=r"sets\[0\]: ") as caught:
        check_sets(document.sets)
    assert message in str(caught.value)


def test_no_error_if_nothing_moves(documents: dict[str, bytes]) -> None:
    content = json.loads(documents["hypotheses"])
    content["status"] = [-1] * 40
    document = decode(json.dumps(content).encode(), HypothesesDocument)
    found = cluster(document, resolve([]))
    assert not found.motions
    assert (found.labels == -1).all()


def test_too_few_tracks_do_not_mean_that_nothing_moves() -> None:
    assert not nothing_moves(np.zeros(2, np.int64), ["affine"])
    assert nothing_moves(np.array([-1, -1, 0]), ["affine"])
    assert not nothing_moves(np.array([-1, 0, 0, 0, 0, 0]), ["affine", "homography"])


@pytest.mark.parametrize("model", ["auto", "affine", "homography"])
def test_mismatches_alone_have_no_motion(model: str, tmp_path: Path) -> None:
    places = np.random.default_rng(0).uniform(0, 480, (200, 4))
    rows = "\n".join(",".join(f"{value:.2f}" for value in row) for row in places)
    (tmp_path / "matches.csv").write_text(f"x1,y1,x2,y2\n{rows}\n")
    out = tmp_path / "out"
    command = ["run", str(tmp_path / "matches.csv"), "--model", model, "--out", str(out), "-q"]
    assert invoke(command) == 0
    report = json.loads((out / "report.json").read_text())
    assert report["motions"] == 0
    assert report["outliers"] == 200
    assert any("no common motion" in note for note in report["notes"])


def test_two_equal_images_have_no_motion(tmp_path: Path) -> None:
    picture = str(Path(__file__).parents[1] / "sample_data" / "affine" / "frame-1.png")
    assert invoke(["run", picture, picture, "--out", str(tmp_path / "out"), "-q"]) == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["motions"] == 0
    assert report["modes"] == []
