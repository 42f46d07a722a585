"""Documents of earlier versions are read where nothing in them must be guessed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import mssegment
from mssegment import documents
from mssegment.cli import invoke
from mssegment.documents import Document, HypothesesDocument, SegmentationDocument
from mssegment.errors import DataError


def earlier(document: Document) -> dict[str, Any]:
    """A document as version 1 wrote it."""
    tree: dict[str, Any] = json.loads(documents.encode(document))
    tree["schema"] = tree["schema"].replace("/2", "/1")
    del tree["strategy"]
    for name, old, new in (
        ("sets", "coordinates", "normalization"),
        ("motions", "set", "set_index"),
        ("modes", "set", "set_index"),
    ):
        for entry in tree.get(name, []):
            entry[old] = entry.pop(new)
    return tree


@pytest.fixture(scope="module")
def found() -> mssegment.Segmentation:
    first = np.random.default_rng(0).uniform(0, 400, (80, 2))
    second = np.where(np.arange(80)[:, None] < 40, first + 9, 1.05 * first - 20)
    points = np.stack([first, second], axis=1)
    return mssegment.segment_tracks(points, {"hypothesize.model": "affine"})


@pytest.mark.parametrize("kind", [HypothesesDocument, SegmentationDocument])
def test_earlier_documents_are_read(kind: type[Document], found: mssegment.Segmentation) -> None:
    document = found.hypotheses if kind is HypothesesDocument else found.segmentation
    content = json.dumps(earlier(document)).encode()
    assert documents.encode(documents.decode(content, kind)) == documents.encode(document)


def test_what_would_be_a_guess_is_said(found: mssegment.Segmentation) -> None:
    tree = earlier(found.hypotheses)
    tree["frames"] *= 2
    with pytest.raises(DataError, match=r"by an earlier version .* run `mssegment hypothesize`"):
        documents.decode(json.dumps(tree).encode(), HypothesesDocument)


def test_an_earlier_document_with_a_fault_is_refused(found: mssegment.Segmentation) -> None:
    tree = earlier(found.segmentation)
    tree["motions"][0]["parameters"] = [1, 2]
    with pytest.raises(DataError, match=r"motions\[0\].parameters has shape 2; expected 3 x 3"):
        documents.decode(json.dumps(tree).encode(), SegmentationDocument)


def test_nothing_left_to_segment_is_a_statement(
    found: mssegment.Segmentation, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    tree = json.loads(documents.encode(found.hypotheses))
    tree["status"] = [-2] * 80
    (tmp_path / "h.json").write_text(json.dumps(tree))
    assert invoke(["cluster", str(tmp_path / "h.json"), "-o", str(tmp_path / "s.json")]) == 0
    assert "no track is left to segment" in capfd.readouterr().err


def test_nothing_of_a_document_reaches_the_terminal_raw(
    found: mssegment.Segmentation, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    tree = json.loads(documents.encode(found.segmentation))
    tree["notes"] = ["\x1b]0;owned\x07\x1b[2J\u202e all is well"]
    tree["history"][0]["notes"] = ["harmless\n\\input{/etc/passwd}"]
    tree["frames"][0]["path"] = "a\x1b[31m.png"
    tree["motions"][0]["model"] = "\x9b31m=cmd"
    (tmp_path / "s.json").write_text(json.dumps(tree))
    for form in ("text", "markdown", "latex"):
        assert invoke(["report", str(tmp_path / "s.json"), "--format", form]) == 0
        out, err = capfd.readouterr()
        for letter in "\x1b\x07\x9b\u202e":
            assert letter not in out + err
        assert not any(line.startswith("\\input") for line in out.splitlines())
    out_folder = str(tmp_path / "out")
    assert invoke(["report", str(tmp_path / "s.json"), "--out", out_folder]) == 0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert not set("\x1b\x07\x9b\u202e") & set(page)
