"""The labelling page's server: what it saves, and everything that it refuses."""

from __future__ import annotations

import http.client
import json
import socket
import struct
import threading
import time

import cv2
import numpy as np
import pytest

from mssegment.datasets import labels_from_masks
from mssegment.documents import write_bytes
from mssegment.errors import DataError, UsageError
from mssegment.ground_truth import true_labels
from mssegment.labelling import LabelServer
from mssegment.labelling.masks import POLYGONS, Drawing, Polygon, mask_files, mask_of
from mssegment.records import Frame

FRAMES = [Frame("a/frame-3.png", 60, 40), Frame("a/frame-7.png", 60, 40)]
SQUARE = [[10, 10], [29, 10], [29, 29], [10, 29]]


@pytest.fixture
def server(tmp_path):
    with LabelServer(FRAMES, lambda index: None, str(tmp_path / "labels")) as server:
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        yield server
        server.shutdown()


def ask(server, path="", method="GET", body=None, **headers):
    connection = http.client.HTTPConnection("127.0.0.1", server.server_port, timeout=10)
    path = path if path.startswith("/") else f"/{server.secret}/{path}"
    connection.putrequest(method, path, skip_host=True)
    for name, value in {"Host": server.hosts[0], **headers}.items():
        connection.putheader(name.replace("_", "-"), value)
    if body is not None:
        connection.putheader("Content-Length", str(len(body)))
    connection.endheaders(body)
    answer = connection.getresponse()
    content = answer.read()
    connection.close()
    return answer, content


def save(server, frames, **headers):
    body = json.dumps({"frames": frames}).encode()
    own = {"Origin": f"http://{server.hosts[0]}", "Content_Type": "application/json"}
    return ask(server, "save", "POST", body, **(own | headers))


def test_it_listens_on_the_loopback_address_only(server):
    assert server.server_address[0] == "127.0.0.1"


@pytest.mark.parametrize("name", ["", "label.css", "label.js", "state.json", "frame-1.jpg"])
def test_it_serves_its_own_files(server, name):
    answer, content = ask(server, name)
    assert answer.status == 200
    assert content
    assert answer.getheader("Content-Security-Policy").startswith("default-src 'none'")
    assert answer.getheader("X-Content-Type-Options") == "nosniff"


@pytest.mark.parametrize("host", ["evil.example", "evil.example:80", "127.0.0.1", "localhost.", ""])
def test_it_refuses_another_host(server, host):
    answer, content = ask(server, Host=host)
    assert answer.status == 403
    assert b"polygon" not in content


@pytest.mark.parametrize(
    "path",
    [
        "/",
        "/etc/passwd",
        "/wrong/label.js",
        "../server.py",
        "../../../../etc/passwd",
        "%2e%2e/server.py",
        "server.py",
        "masks.py",
        "polygons.json",
        "frame-2.jpg",
        "frame--1.jpg",
        "frame-1.jpg/",
        "label.js?x=1",
    ],
)
def test_it_refuses_everything_else(server, path):
    assert ask(server, path)[0].status == 404


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "HEAD"])
def test_it_knows_two_methods(server, method):
    assert ask(server, "", method)[0].status == 501


def test_it_saves_masks_that_the_report_reads(server):
    answer, content = save(server, [[{"label": 2, "points": SQUARE}], []])
    assert answer.status == 200
    assert b"mask-3.png" in content
    mask = cv2.imread(str(server.folder / "mask-3.png"), cv2.IMREAD_UNCHANGED)
    assert mask.shape == (40, 60)
    assert set(np.unique(mask)) == {0, 2}
    assert mask[20, 20] == 2
    assert mask[10, 10] == 2
    assert mask[5, 5] == 0
    points = np.array([[[20.0, 20.0], [22.0, 20.0]], [[50.0, 5.0], [51.0, 5.0]]])
    assert labels_from_masks(points, {0: mask}).tolist() == [2, 0]
    from mssegment.records import Tracks

    found = true_labels([str(server.folder / "mask-3.png")], Tracks(points), FRAMES, 3.0)
    assert found.tolist() == [2, 0]


def test_one_can_go_on_later_and_a_deleted_polygon_takes_its_mask_along(server):
    save(server, [[{"label": 1, "points": SQUARE}], [{"label": 1, "points": SQUARE}]])
    assert (server.folder / "mask-7.png").exists()
    save(server, [[{"label": 1, "points": SQUARE}], []])
    assert not (server.folder / "mask-7.png").exists()
    again = LabelServer(FRAMES, lambda index: None, str(server.folder))
    again.server_close()
    assert again.drawing.frames[0][0].label == 1
    with pytest.raises(DataError, match="choose another folder"):
        LabelServer(FRAMES[:1], lambda index: None, str(server.folder))


def test_only_its_own_page_may_save(server):
    good = [[{"label": 1, "points": SQUARE}], []]
    assert save(server, good, Origin="http://evil.example")[0].status == 403
    assert save(server, good, Origin="null")[0].status == 403
    assert save(server, good, Content_Type="text/plain")[0].status == 415
    assert save(server, good, Host="evil.example")[0].status == 403
    assert not (server.folder / POLYGONS).exists()


@pytest.mark.parametrize(
    "frames",
    [
        [],
        [[], [], []],
        [[{"label": 300, "points": SQUARE}], []],
        [[{"label": -1, "points": SQUARE}], []],
        [[{"label": 1, "points": SQUARE[:2]}], []],
        [[{"label": 1, "points": [[0, 0], [1e9, 0], [0, 1]]}], []],
        [[{"label": 1, "points": [["a", 0], [1, 0], [0, 1]]}], []],
        [[{"label": 1, "points": SQUARE, "path": "/etc"}], []],
        "x",
    ],
)
def test_wrong_polygons_are_named_and_nothing_is_written(server, frames):
    answer, content = save(server, frames)
    assert answer.status == 400
    assert content
    assert b"\n" not in content
    assert list(server.folder.iterdir()) == []


def test_a_later_polygon_covers_an_earlier_one():
    hole = [[15, 15], [24, 15], [24, 24], [15, 24]]
    polygons = [Polygon(1, SQUARE), Polygon(0, hole), Polygon(255, [[0, 0], [5, 0], [0, 5]])]
    mask = mask_of(polygons, FRAMES[0])
    assert mask[12, 12] == 1
    assert mask[20, 20] == 0
    assert mask[1, 1] == 255


def test_frames_that_names_cannot_tell_apart_get_a_mask_each():
    frames = [Frame("a/1.png", 60, 40), Frame("b/1.png", 60, 40)]
    files = mask_files(Drawing([[Polygon(1, SQUARE)], []]), frames)
    assert list(files) == ["mask-1.png", "mask-2.png"]
    blank = cv2.imdecode(np.frombuffer(files["mask-2.png"], np.uint8), cv2.IMREAD_UNCHANGED)
    assert (blank == 255).all()


def test_it_does_not_write_over_masks_of_somebody_else(tmp_path):
    (tmp_path / "mask-1.png").write_bytes(b"mine")
    with pytest.raises(UsageError, match="did not draw"):
        LabelServer(FRAMES, lambda index: None, str(tmp_path))


def test_a_port_that_is_taken_is_named(server, tmp_path):
    with pytest.raises(UsageError, match=str(server.server_port)):
        LabelServer(FRAMES, lambda index: None, str(tmp_path), port=server.server_port)


def test_a_killed_save_is_completed_at_the_next_start(tmp_path):
    def drawing(label):
        polygons = [{"label": label, "points": SQUARE}]
        return json.dumps({"frames": [polygons, polygons]}).encode()

    folder = tmp_path / "labels"
    with LabelServer(FRAMES, lambda index: None, str(folder)) as server:
        server.save(drawing(2))
        after = {path.name: path.read_bytes() for path in folder.iterdir()}
        server.save(drawing(1))
    # killed when the polygons and one of the masks of label 2 were written
    (folder / POLYGONS).write_bytes(after[POLYGONS])
    (folder / "mask-3.png").write_bytes(after["mask-3.png"])
    (folder / ".mask-7.png.0123456789ab").write_bytes(b"half")
    with LabelServer(FRAMES, lambda index: None, str(folder)):
        assert {path.name: path.read_bytes() for path in folder.iterdir()} == after


def test_saves_come_one_after_the_other_and_end_before_the_program(tmp_path, monkeypatch):
    from mssegment.labelling import server as module

    written = []

    def slow(path, content):
        written.append(path)
        time.sleep(0.02)
        write_bytes(path, content)

    monkeypatch.setattr(module, "write_bytes", slow)
    with LabelServer(FRAMES, lambda index: None, str(tmp_path / "labels")) as server:
        threading.Thread(target=server.serve_forever, args=(0.02,), daemon=True).start()
        bodies = [[{"label": label, "points": SQUARE}] for label in (1, 2, 3)]
        asked = [threading.Thread(target=save, args=(server, [b, b])) for b in bodies]
        for thread in asked:
            thread.start()
        for thread in asked:
            thread.join()
        assert [path[-13:] for path in written[::3]] == [POLYGONS] * 3  # never interleaved
        values = {cv2.imread(str(path)).max() for path in server.folder.glob("*.png")}
        assert values == {server.drawing.frames[0][0].label}

        threading.Thread(target=save, args=(server, [bodies[0]] * 2)).start()
        while len(written) < 10:
            time.sleep(0.001)
        server.finish()  # as Ctrl-C does
        assert len(written) == 12
        assert (tmp_path / "labels" / "mask-7.png").read_bytes()
        server.shutdown()


def test_a_closed_tab_is_no_error(server, capfd):
    said = []
    server.trouble = said.append
    with socket.create_connection(("127.0.0.1", server.server_port)) as connection:
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        head = f"GET /{server.secret}/frame-0.jpg HTTP/1.1\r\nHost: {server.hosts[0]}\r\n\r\n"
        connection.sendall(head.encode())
    assert save(server, [[], []])[0].status == 200
    time.sleep(0.1)
    assert not said
    assert capfd.readouterr() == ("", "")
