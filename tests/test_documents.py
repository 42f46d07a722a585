"""Documents: a round trip changes nothing, and everything that is wrong is said in one line."""

from __future__ import annotations

import base64
import contextlib
import json
import os
import re
import stat
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from mssegment.documents import (
    DOCUMENTS,
    CornersDocument,
    Document,
    HistoryEntry,
    HypothesesDocument,
    SegmentationDocument,
    TracksDocument,
    decode,
    encode,
    read_document,
    write_document,
)
from mssegment.documents.arrays import LIST_LIMIT
from mssegment.errors import DataError, UsageError
from mssegment.records import (
    Camera,
    Corners,
    Frame,
    HypothesisSet,
    Mode,
    Motion,
    Normalization,
    Tracks,
)

FRAMES = [Frame("a.png", 640, 480, "0f"), Frame("clip.mp4", 640, 480, "f0", index=7)]
finite = st.floats(-1e6, 1e6)


def tracks_document(points: np.ndarray) -> TracksDocument:
    return TracksDocument(
        frames=FRAMES,
        camera=Camera(800.0, 800.0, 320.0, 240.0, (0.1, -0.2)),
        tracks=Tracks(points, labels=np.arange(len(points))),
        history=[
            HistoryEntry("match", "0.1.0", {"match.method": "affine", "seed": 3}, ("a note",))
        ],
    )


def example_documents() -> list[Document]:
    points = np.arange(12.0).reshape(3, 2, 2)
    tracks = Tracks(points, affines=np.zeros((3, 2, 2)), labels=np.array([1, 0, 2]))
    chosen = HypothesisSet(
        "affine",
        "affine(2)",
        (0, 1),
        Normalization(np.zeros((2, 2)), 100.0),
        np.array([[0, 1, 2]]),
        np.eye(3)[None],
        drawn=4,
    )
    return [
        CornersDocument(
            frames=FRAMES,
            corners=[Corners(np.ones((n, 2)), np.ones(n), np.ones(n)) for n in (3, 0)],
        ),
        tracks_document(points),
        HypothesesDocument(
            frames=FRAMES,
            tracks=tracks,
            status=np.array([0, -1, -2]),
            strategy="modes",
            sets=[chosen],
        ),
        SegmentationDocument(
            frames=FRAMES,
            tracks=tracks,
            strategy="modes",
            sets=[chosen],
            labels=np.array([1, -1, 0]),
            motions=(Motion(1, 0, "affine", np.eye(3), np.array([0]), 0.5, 0.4, None),),
            modes=(Mode(0, 1, 0.3, np.eye(3), 1),),
            bandwidths=(0.1,),
            notes=("said",),
            residuals=np.array([[0.1, np.nan, 3.0]]),
            assignments=(np.array([0]),),
        ),
    ]


def equal(one: Any, other: Any) -> bool:
    """Whether two documents, or parts of them, are the same, arrays and NaN included."""
    if isinstance(one, np.ndarray):
        same = one.shape == other.shape or one.size == other.size == 0
        return same and one.dtype == other.dtype and np.array_equal(one, other, equal_nan=True)
    if isinstance(one, (list, tuple)):
        return len(one) == len(other) and all(map(equal, one, other))
    names = getattr(one, "__struct_fields__", None) or getattr(one, "__dataclass_fields__", None)
    if names:
        return all(equal(getattr(one, name), getattr(other, name)) for name in names)
    return bool(one == other)


@pytest.mark.parametrize("document", example_documents(), ids=lambda document: document.kind)
def test_round_trip_of_every_document(document: Document) -> None:
    content = encode(document)
    again = decode(content, type(document))
    assert equal(document, again)
    assert encode(again) == content


def test_every_document_has_an_example() -> None:
    assert {type(document) for document in example_documents()} == set(DOCUMENTS.values())


@given(
    arrays.arrays(np.float64, st.tuples(st.integers(1, 5), st.just(2), st.just(2)), elements=finite)
)
def test_round_trip_keeps_every_bit_of_a_number(points: np.ndarray) -> None:
    again = decode(encode(tracks_document(points)), TracksDocument)
    assert again.tracks.points.tobytes() == (points + 0.0).tobytes() or equal(
        again.tracks.points, points
    )


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=6))
def test_what_is_not_seen_is_null_and_comes_back(seen: list[tuple[bool, bool]]) -> None:
    points = np.where(np.array(seen)[..., None], 1.5, np.nan) * np.ones(2)
    content = encode(tracks_document(points))
    assert b"NaN" not in content
    assert np.array_equal(decode(content, TracksDocument).tracks.visible, np.array(seen))


def test_many_numbers_are_written_as_base64_and_both_forms_are_read() -> None:
    points = np.random.default_rng(0).normal(size=(LIST_LIMIT // 4 + 1, 2, 2))
    points[0, 1] = np.nan
    document = tracks_document(points)
    content = json.loads(encode(document))
    assert set(content["tracks"]["points"]) == {"dtype", "shape", "base64"}
    content["tracks"]["points"] = np.where(np.isnan(points), None, points).tolist()
    as_lists = decode(json.dumps(content).encode(), TracksDocument)
    assert equal(document, as_lists)


def change(path: list[Any], value: Any) -> bytes:
    content: Any = json.loads(encode(tracks_document(np.ones((3, 2, 2)))))
    place = content
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return json.dumps(content).encode()


def b64(**changes: Any) -> dict[str, Any]:
    raw = base64.b64encode(np.ones((3, 2, 2)).tobytes()).decode()
    return {"dtype": "<f8", "shape": [3, 2, 2], "base64": raw} | changes


INFINITY = base64.b64encode(np.full((3, 2, 2), np.inf).tobytes()).decode()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (change(["tracks", "points", 1, 0, 1], "x"), "got str at $.tracks.points[1][0][1]"),
        (change(["tracks", "points", 1, 0], [1, 2, 3]), "at $.tracks.points"),
        (change(["tracks", "points", 1, 0], [1, None]), "one number and one null"),
        (change(["tracks", "points"], []), "tracks.points has shape 0; expected n x 2 x 2"),
        (change(["tracks", "points"], [[[1, 2], [3, 4]]]), "tracks.labels has shape 3; expected 1"),
        (change(["tracks", "points"], b64(dtype="<f4")), "expected dtype <f8, got '<f4'"),
        (change(["tracks", "points"], b64(shape=[3, 2])), "numbers of 8 bytes"),
        (change(["tracks", "points"], b64(shape=[3, -2, -2])), "numbers of 8 bytes"),
        (change(["tracks", "points"], b64(base64="%%%")), "expected base64"),
        (change(["tracks", "points"], b64(base64=INFINITY)), "got infinity"),
        (change(["tracks", "points"], 7), "expected an array, got int"),
        (change(["tracks", "labels"], [1, 2]), "tracks.labels has shape 2"),
        (change(["tracks", "labels", 0], 1.5), "expected int, got float at $.tracks.labels[0]"),
        (change(["frames", 0, "width"], "w"), "expected int, got str at $.frames[0].width"),
        (change(["frames", 0, "width"], -5), "frames[0] has size -5x480"),
        (
            change(["tracks", "points", 1, 0, 1], 1e300),
            "points[1][0][1] is 1e+300; expected at most",
        ),
        (change(["tracks"], {}), "missing required field points at $.tracks"),
        (change(["schema"], "mssegment/tracks/9"), "written by a later version of mssegment"),
        (change(["schema"], "mssegment/nothing/1"), "unknown schema 'mssegment/nothing/1'"),
        (change(["schema"], "mssegment/corners/1"), "run `mssegment match` on it first"),
        (change(["schema"], "mssegment/segmentation/2"), "written by `mssegment match`"),
        (b'{"points": []}', "not an mssegment document"),
        (b"[1, 2]", "not an mssegment document"),
        (b'{"schema": "mssegment/tracks/1", "frames": [', "not JSON"),
        (b'{"schema": "mssegment/tracks/1", "tracks": {"points": [[[NaN, 1]]]}}', "NaN at byte"),
        (b'{"schema": "mssegment/tracks/1", "tracks": {"points": [[[Infinity]]]}}', "Infinity at"),
        (b"\xff\xfe\x00", "x.json"),
    ],
)
def test_what_is_wrong_is_said_in_one_line(content: bytes, said: str) -> None:
    with pytest.raises(DataError) as caught:
        decode(content, TracksDocument, "x.json")
    message = str(caught.value)
    assert message.startswith("x.json: ")
    assert said in message
    assert "\n" not in message


@settings(max_examples=200)
@given(st.binary(max_size=60) | st.text(max_size=60).map(str.encode))
def test_any_bytes_are_read_or_refused_but_never_crash(content: bytes) -> None:
    for kind in DOCUMENTS.values():
        with pytest.raises(DataError):
            decode(content, kind)


@given(
    st.recursive(
        st.none() | st.booleans() | finite | st.text(),
        lambda x: st.lists(x) | st.dictionaries(st.text(), x),
    )
)
def test_any_json_in_place_of_an_array_is_read_or_refused(value: Any) -> None:
    with contextlib.suppress(DataError):
        decode(change(["tracks", "points"], value), TracksDocument)


def test_a_later_document_names_the_stages_that_lie_between() -> None:
    corners = example_documents()[0]
    between = "run `mssegment match | mssegment hypothesize | mssegment cluster` on it first"
    with pytest.raises(DataError, match=re.escape(between)):
        decode(encode(corners), SegmentationDocument)


def test_missing_and_empty_files_and_folders_are_named(tmp_path: Path) -> None:
    (tmp_path / "empty.json").write_bytes(b" \n")
    for name, said in (("none.json", "no such file"), ("empty.json", "empty"), (".", "a folder")):
        with pytest.raises(DataError, match=said):
            read_document(str(tmp_path / name), TracksDocument)


def test_a_file_is_written_whole_or_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    target = tmp_path / "tracks.json"
    target.write_text("before")

    def full_disk(handle: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(UsageError, match="No space left"):
        write_document(str(target), tracks_document(np.ones((3, 2, 2))))
    assert target.read_text() == "before"
    assert [path.name for path in tmp_path.iterdir()] == ["tracks.json"]


def test_a_link_is_followed_and_a_device_is_never_replaced(tmp_path: Path) -> None:
    (tmp_path / "real.json").write_text("old")
    (tmp_path / "link.json").symlink_to(tmp_path / "real.json")
    write_document(str(tmp_path / "link.json"), tracks_document(np.ones((1, 2, 2))))
    assert (tmp_path / "link.json").is_symlink()
    assert (tmp_path / "real.json").read_text().startswith("{")
    write_document(os.devnull, tracks_document(np.ones((1, 2, 2))))
    assert not Path(os.devnull).is_file()
    with pytest.raises(UsageError, match="this is a folder"):
        write_document(str(tmp_path), tracks_document(np.ones((1, 2, 2))))


def test_a_written_file_has_the_permissions_of_the_user(tmp_path: Path) -> None:
    write_document(str(tmp_path / "t.json"), tracks_document(np.ones((3, 2, 2))))
    (tmp_path / "plain").touch()
    modes = {stat.S_IMODE(path.stat().st_mode) for path in tmp_path.iterdir()}
    assert len(modes) == 1


def test_a_folder_that_is_not_there_is_a_usage_error(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="cannot be written"):
        write_document(str(tmp_path / "no" / "t.json"), tracks_document(np.ones((3, 2, 2))))
