"""A web server for one person on this machine: loopback only, a fixed list of addresses.

It opens no file by a name that comes from a request, answers only requests whose Host is its own
(so that no web site can reach it through a name that points to this machine), and takes labels
only from its own page. A secret part of the address keeps other users of the machine out.
"""

from __future__ import annotations

import secrets
from collections.abc import Callable, Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np

from mssegment.documents.files import read_bytes, write_bytes
from mssegment.errors import DataError, MssegmentError, UsageError
from mssegment.labelling import masks
from mssegment.records import Frame
from mssegment.rendering.report import PictureOf
from mssegment.rendering.style import hexadecimal, label_style

LOOPBACK = "127.0.0.1"
LARGEST_REQUEST = 16_000_000
_KINDS = {"html": "text/html", "css": "text/css", "js": "text/javascript"}


class LabelServer(ThreadingHTTPServer):
    """Serves the labelling page for ``frames`` and saves masks into ``folder``.

    ``port`` 0 takes any free port; ``url`` is where the page is. ``saved`` is called with the
    names of the files after each save. Raises UsageError where the port is taken or the folder
    cannot be written, DataError where it holds polygons of other frames.
    """

    daemon_threads = True

    def __init__(
        self,
        frames: Sequence[Frame],
        pictures: PictureOf,
        folder: str,
        *,
        port: int = 0,
        saved: Callable[[list[str]], None] | None = None,
    ) -> None:
        self.frames, self.pictures, self.folder = tuple(frames), pictures, Path(folder)
        self.saved = saved or (lambda names: None)
        self.drawing = _earlier_drawing(self.folder, self.frames)
        self.secret = secrets.token_urlsafe(12)
        try:
            super().__init__((LOOPBACK, port), _Handler)
        except OSError as error:
            raise UsageError(
                f"port {port} cannot be used ({error.strerror}); choose another, or 0 for any"
            ) from None

    @property
    def url(self) -> str:
        """The address of the page."""
        return f"http://{LOOPBACK}:{self.server_port}/{self.secret}/"

    @property
    def hosts(self) -> tuple[str, ...]:
        """What the Host header of a request may say."""
        return f"{LOOPBACK}:{self.server_port}", f"localhost:{self.server_port}"

    def save(self, content: bytes) -> list[str]:
        """Writes the masks and the polygons; the names of the files. Raises DataError."""
        drawing = masks.read_drawing(content, self.frames)
        files = masks.mask_files(drawing, self.frames)
        files[masks.POLYGONS] = masks.encode_drawing(drawing)
        for name in masks.mask_files(self.drawing, self.frames).keys() - files.keys():
            (self.folder / name).unlink(missing_ok=True)  # its last polygon was deleted
        for name, written in files.items():
            write_bytes(str(self.folder / name), written)
        self.drawing = drawing
        self.saved(list(files))
        return list(files)


def serve(
    frames: Sequence[Frame],
    pictures: PictureOf,
    folder: str,
    *,
    port: int = 0,
    ready: Callable[[str], None] | None = None,
    saved: Callable[[list[str]], None] | None = None,
) -> None:
    """Serves the page until Ctrl-C (KeyboardInterrupt goes through); ``ready`` gets its address."""
    with LabelServer(frames, pictures, folder, port=port, saved=saved) as server:
        if ready is not None:
            ready(server.url)
        server.serve_forever(poll_interval=0.2)


def _earlier_drawing(folder: Path, frames: Sequence[Frame]) -> masks.Drawing:
    """The polygons that the folder holds, or none; makes the folder."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"{folder}: cannot be made ({error.strerror}); choose another") from None
    earlier = folder / masks.POLYGONS
    if earlier.exists():
        try:
            return masks.read_drawing(read_bytes(str(earlier)), frames)
        except DataError as error:
            raise DataError(f"{earlier}: {error}; choose another folder with --out") from None
    if any(folder.glob("mask-*.png")):
        raise UsageError(f"{folder}: holds masks that this page did not draw; choose another --out")
    return masks.Drawing([[] for _ in frames])


class _Handler(BaseHTTPRequestHandler):
    server: LabelServer
    server_version = "mssegment"
    sys_version = ""
    protocol_version = "HTTP/1.1"
    timeout = 30

    common: ClassVar[dict[str, str]] = {
        "Content-Security-Policy": (
            "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
            "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
        ),
        "X-Content-Type-Options": "nosniff",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
    }

    def do_GET(self) -> None:
        """The page, its parts, or a frame; anything else is refused."""
        asked = self._asked()
        if asked is None:
            return
        if asked in ("", "label.css", "label.js"):
            name = asked or "label.html"
            content = resources.files(__package__).joinpath(name).read_bytes()
            self._answer(HTTPStatus.OK, content, _KINDS[name.rpartition(".")[2]])
        elif asked == "state.json":
            state = masks.state_of(self.server.frames, self.server.drawing, _looks())
            self._answer(HTTPStatus.OK, state, "application/json")
        elif asked in {f"frame-{i}.jpg" for i in range(len(self.server.frames))}:
            content = self._frame(int(asked[6:-4]))
            self._answer(HTTPStatus.OK, content, "image/jpeg")
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "there is nothing here")

    def do_POST(self) -> None:
        """Takes the polygons from our own page and writes the masks."""
        asked = self._asked()
        if asked is None:
            return
        length = self.headers.get("Content-Length", "")
        if asked != "save":
            self._refuse(HTTPStatus.NOT_FOUND, "there is nothing here")
        elif self.headers.get("Origin") not in {f"http://{host}" for host in self.server.hosts}:
            self._refuse(HTTPStatus.FORBIDDEN, "only the page itself may save")
        elif self.headers.get("Content-Type") != "application/json":
            self._refuse(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "JSON was expected")
        elif not length.isdecimal() or int(length) > LARGEST_REQUEST:
            self._refuse(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, "too many polygons")
        else:
            self._save(self.rfile.read(int(length)))

    def _save(self, content: bytes) -> None:
        try:
            names = self.server.save(content)
        except MssegmentError as error:
            self._refuse(HTTPStatus.BAD_REQUEST, str(error))
            return
        text = f"saved {', '.join(names)} in {self.server.folder}"
        self._answer(HTTPStatus.OK, text.encode(), "text/plain")

    def _asked(self) -> str | None:
        """What is asked for below the secret part of the address; None if that was refused."""
        if self.headers.get("Host") not in self.server.hosts:
            self._refuse(HTTPStatus.FORBIDDEN, "this page is for this machine only")
            return None
        prefix = f"/{self.server.secret}/"
        path = self.path
        if not secrets.compare_digest(path[: len(prefix)].encode(), prefix.encode()):
            self._refuse(HTTPStatus.NOT_FOUND, "there is nothing here")
            return None
        return path[len(prefix) :]

    def _frame(self, index: int) -> bytes:
        picture = self.server.pictures(index)
        if picture is None:
            frame = self.server.frames[index]
            picture = np.full((frame.height, frame.width, 3), 236, dtype=np.uint8)
        options = [cv2.IMWRITE_JPEG_QUALITY, 92]
        return bytes(cv2.imencode(".jpg", np.ascontiguousarray(picture), options)[1].tobytes())

    def _refuse(self, status: HTTPStatus, text: str) -> None:
        self.close_connection = True  # what is left of the request is not read
        self._answer(status, text.encode(), "text/plain")

    def _answer(self, status: HTTPStatus, content: bytes, kind: str) -> None:
        self.send_response(status)
        charset = "" if kind == "image/jpeg" else "; charset=utf-8"
        self.send_header("Content-Type", kind + charset)
        self.send_header("Content-Length", str(len(content)))
        for name, value in self.common.items():
            self.send_header(name, value)
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, format: str, *args: object) -> None:
        """Nothing: the terminal is for the user."""


def _looks() -> list[dict[str, object]]:
    """The colours of the first labels, as everywhere."""
    return [
        {
            "label": label,
            "colour": hexadecimal(label_style(label).colour),
            "glyph": label_style(label).glyph,
        }
        for label in range(1, 57)
    ]
