"""Reading what others wrote: plain files and pipes, limits, YAML, text that is fit to be shown."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import threading
import unicodedata
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mssegment import datasets, documents
from mssegment.configuration import KEYS, from_text
from mssegment.errors import ConfigurationError, DataError, MssegmentError
from mssegment.imaging.frames import open_frames
from mssegment.inputs import limits
from mssegment.inputs.files import check_kind, read_file
from mssegment.inputs.text import printable, printable_lines
from mssegment.inputs.yaml_nodes import check_nodes
from mssegment.labelling.masks import read_drawing
from mssegment.records import Frame, Tracks


def test_a_plain_file_is_read_whole(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"\0\r\n\xff" * 300_000)
    assert read_file(str(tmp_path / "file")) == b"\0\r\n\xff" * 300_000


@pytest.mark.parametrize(
    ("name", "word"),
    [("absent", "no such file"), (".", "folder"), ("a\0b", "not a possible"), ("x" * 5000, "long")],
)
def test_what_is_no_file_is_said(tmp_path: Path, name: str, word: str) -> None:
    with pytest.raises(DataError, match=word):
        read_file(str(tmp_path / name) if name != "a\0b" else name)


def test_devices_and_sockets_are_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="a device"):
        read_file("/dev/zero")
    with socket.socket(socket.AF_UNIX) as own:
        own.bind(str(tmp_path / "s"))
        with pytest.raises(DataError, match="pipe or socket"):
            read_file(str(tmp_path / "s"))


def test_a_pipe_is_read_to_its_end(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    content = b"x" * 300_000
    writer = threading.Thread(target=lambda: pipe.write_bytes(content))
    writer.start()
    assert read_file(str(pipe)) == content
    writer.join()
    with pytest.raises(DataError, match="pipe"):
        check_kind(str(pipe))


def test_a_pipe_waits_for_a_slow_program() -> None:
    slow = subprocess.Popen(["sh", "-c", "sleep 0.3; echo late"], stdout=subprocess.PIPE)
    assert slow.stdout is not None
    assert read_file(f"/dev/fd/{slow.stdout.fileno()}") == b"late\n"
    slow.wait()


def test_a_pipe_without_a_program_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mssegment.inputs.files._PATIENCE", 0.1)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(DataError, match="no program writes into this pipe"):
        read_file(str(tmp_path / "pipe"))


def test_every_limit_can_be_raised(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, own in limits.LIMITS.items():
        assert f"limits.{name}" in KEYS
        assert KEYS[f"limits.{name}"].default == own.default == limits.limit(name)
        with pytest.raises(DataError, match=limits.variable_of(name)) as caught:
            limits.check(name, own.default + 1, "it")
        assert f"{own.default:,}" in str(caught.value)
        limits.check(name, own.default, "it")
        with limits.using({name: own.default + 1}):
            limits.check(name, own.default + 1, "it")
        monkeypatch.setenv(limits.variable_of(name), str(own.default + 1))
        limits.check(name, own.default + 1, "it")


def test_a_file_above_the_limit_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"123456")
    with limits.using({"file_bytes": 5}), pytest.raises(DataError, match=r"6 bytes.*limit of 5"):
        read_file(str(tmp_path / "file"))


def laughs(levels: int, each: int) -> str:
    """Aliases that expand to ``each ** levels`` values."""
    lines = ["a0: &a0 [x]"]
    for level in range(1, levels + 1):
        inside = ", ".join([f"*a{level - 1}"] * each)
        lines.append(f"a{level}: &a{level} [{inside}]")
    return "\n".join(lines)


@pytest.mark.parametrize("levels", [6, 9, 200])
def test_aliases_are_counted_as_what_they_expand_to(levels: int) -> None:
    node = yaml.compose(laughs(levels, 9), Loader=yaml.SafeLoader)
    with pytest.raises(ConfigurationError, match="values, more than the limit"):
        check_nodes(node, "it", ConfigurationError)


def test_few_aliases_are_read() -> None:
    check_nodes(yaml.compose(laughs(3, 9), Loader=yaml.SafeLoader), "it", ConfigurationError)
    assert from_text(["report.labels=[&a x, *a]"])[0].value == ["x", "x"]


@pytest.mark.parametrize("text", ["&a [*a]", "&a {k: *a}", "&a {k: [1, &b [*a, *b]]}"])
def test_an_alias_of_itself_is_said(text: str) -> None:
    with pytest.raises(ConfigurationError, match="contains itself"):
        from_text([f"report.labels={text}"])


@given(st.text())
def test_printable_text_has_nothing_that_a_terminal_obeys(text: str) -> None:
    hidden = {"Cc", "Cf", "Cn", "Co", "Cs", "Zl", "Zp"}
    assert not {unicodedata.category(letter) for letter in printable(text)} & hidden
    lines = printable_lines(text)
    assert not {unicodedata.category(letter) for letter in lines if letter not in "\n\t"} & hidden
    assert lines.count("\n") == text.count("\n")


@given(st.text(alphabet="ab ", max_size=60), st.integers(6, 40))
def test_long_text_keeps_its_beginning_and_its_end(text: str, longest: int) -> None:
    cut = printable(text, longest)
    assert len(cut) <= longest
    if len(text) > longest:
        start, _, end = cut.partition("...")
        assert text.startswith(start)
        assert text.endswith(end)
        assert start
        assert end
    else:
        assert cut == text


def _tracks_document(folder: Path) -> object:
    points = np.zeros((2, 2, 2))
    frames = [Frame("a longer name.png", 9, 9)] * 2
    content = documents.encode(documents.TracksDocument(frames=frames, tracks=Tracks(points)))
    return documents.decode(content, documents.TracksDocument)


def _stack(folder: Path) -> object:
    pages = [np.full((20, 20), level, np.uint8) for level in (0, 90)]
    cv2.imwritemulti(str(folder / "s.tif"), pages)
    return open_frames([str(folder / "s.tif")])


def _picture(folder: Path) -> object:
    cv2.imwrite(str(folder / "p.png"), np.zeros((20, 20), np.uint8))
    return open_frames([str(folder / "p.png")] * 2)


def _table(folder: Path) -> object:
    (folder / "t.csv").write_text("track,frame,x,y\n" + "1,0,5,6\n1,1,6,7\n2,0,8,9\n2,1,9,9\n" * 1)
    return datasets.read(folder / "t.csv").tracks


def _arrays(folder: Path) -> object:
    np.savez(folder / "t.npz", tracks=np.ones((5, 2, 2)))
    return datasets.read(folder / "t.npz")


def _drawing(folder: Path) -> object:
    square = [(0, 0), (5, 0), (5, 5), (0, 5)]
    content = json.dumps({"frames": [[{"label": 1, "points": square}]]}).encode()
    return read_drawing(content, [Frame("a.png", 9, 9)])


@pytest.mark.parametrize(
    ("name", "low", "read"),
    [
        ("file_bytes", 3, _picture),
        ("picture_pixels", 399, _picture),
        ("stack_pixels", 799, _stack),
        ("text_bytes", 20, _table),
        ("positions", 3, _table),
        ("unpacked_bytes", 159, _arrays),
        ("text_length", 10, _tracks_document),
        ("yaml_values", 2, lambda folder: from_text(["report.labels=[a, b]"])),
        ("polygon_vertices", 3, _drawing),
    ],
)
def test_every_limit_bounds_something(
    name: str, low: int, read: Callable[[Path], object], tmp_path: Path
) -> None:
    read(tmp_path)
    with limits.using({name: low}), pytest.raises(MssegmentError) as caught:
        read(tmp_path)
    assert f"(limits.{name})" in str(caught.value)
    assert limits.variable_of(name) in str(caught.value)
