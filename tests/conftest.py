"""Fixtures that every test may use."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest

from mssegment import documents


def find_data_folder() -> Path | None:
    """The folder with the real data sets, or None where there is none."""
    named = os.environ.get("MSSEGMENT_DATA")
    folder = Path(named) if named else Path(__file__).parents[2] / "shared" / "data"
    return folder if folder.is_dir() else None


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder with the real data sets; the test skips, saying why, where it is absent."""
    folder = find_data_folder()
    if folder is None:
        pytest.skip("no real data: set MSSEGMENT_DATA, or put it into ../shared/data")
    return folder


@pytest.fixture(autouse=True)
def every_document_is_valid(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever a test writes must be what the next command reads."""
    written = documents.encode

    def encode(document: documents.Document) -> bytes:
        content = written(document)
        documents.decode(content, type(document), "the document that was just written")
        return content

    monkeypatch.setattr(documents, "encode", encode)


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator with a fixed seed."""
    return np.random.default_rng(20060617)
