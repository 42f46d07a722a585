"""The web server of the labelling page: for one user, on the loopback address only.

It opens no file by a name from a request. It answers only requests whose Host header is its own,
so that no web site can reach it through a name that resolves to this machine, and accepts polygons
from its own page only. A secret in the URL keeps other users of the machine out.
"""

from __future__ import annotations

import secrets
import sys
import threading
import time
from collections.abc import Callable, Sequence
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import ClassVar

import cv2
import numpy as np

from mssegment.documents.files import read_bytes, write_bytes
from mssegment.errors import DataError, MssegmentError, OutputError, UsageError
from mssegment.folders import folder_lock
from mssegment.labelling import masks
from mssegment.records import Frame
from mssegment.rendering.report import PictureOf
from mssegment.rendering.style import hexadecimal, label_style

LOOPBACK = "127.0.0.1"
LONGEST_SAVE = 30.0
"""Seconds to wait for a save when the program ends."""
MAX_REQUEST_BYTES = 16_000_000
_CONTENT_TYPES = {"html": "text/html", "css": "text/css", "js": "text/javascript"}


class LabelServer(ThreadingHTTPServer):
    """Serves the labelling page and saves masks.

    Parameters
    ----------
    frames : sequence of Frame
        The frames.
    pictures : callable
        Gives the picture of a frame (BGR) by its index, or None.
    folder : str
        Folder of the masks and the polygons; created if it does not exist.
    port : int
        Port on the loopback address; 0 selects a free one.
    saved : callable, optional
        Called with the names of the files after each save.
    trouble : callable, optional
        Called with a sentence if a request fails for a reason that nobody foresaw.

    Raises
    ------
    UsageError
        If the port is in use, or the folder cannot be written or holds masks from elsewhere.
    DataError
        If the folder holds polygons of other frames.
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
        trouble: Callable[[str], None] | None = None,
    ) -> None:
        self.frames, self.pictures, self.folder = tuple(frames), pictures, Path(folder)
        self.saved = saved or (lambda names: None)
        self.trouble = trouble or (lambda sentence: None)
        self.saving = threading.RLock()
        """Held during a save and its answer: saves come one after the other."""
        self.drawing = _earlier_drawing(self.folder, self.frames)
        self._complete()
        self.secret = secrets.token_urlsafe(12)
        try:
            super().__init__((LOOPBACK, port), _Handler)
        except OSError as error:
            raise UsageError(
                f"port {port}: cannot be used ({error.strerror}); choose another, or 0 for any"
            ) from None

    @property
    def url(self) -> str:
        """The URL of the page."""
        return f"http://{LOOPBACK}:{self.server_port}/{self.secret}/"

    @property
    def hosts(self) -> tuple[str, ...]:
        """The accepted Host headers."""
        return f"{LOOPBACK}:{self.server_port}", f"localhost:{self.server_port}"

    def save(self, content: bytes) -> list[str]:
        """Write masks and polygons from the JSON of a request; returns the names of the files.

        The polygons decide: after a kill in the middle, the next start writes the masks that are
        missing. Raises DataError if the polygons are invalid, OutputError if a file cannot be
        written.
        """
        drawing = masks.read_drawing(content, self.frames)
        with self.saving:
            files = masks.mask_files(drawing, self.frames)
            for name in masks.mask_files(self.drawing, self.frames).keys() - files.keys():
                self._remove(self.folder / name)  # its last polygon was deleted
            polygons = masks.encode_drawing(drawing)
            write_bytes(str(self.folder / masks.POLYGONS), polygons)
            self.drawing = drawing
            for name, written in files.items():
                write_bytes(str(self.folder / name), written)
            names = [*files, masks.POLYGONS]
            self.saved(names)
        return names

    def finish(self) -> None:
        """Wait for a save that is going on, and accept no other one."""
        until = time.monotonic() + LONGEST_SAVE
        while time.monotonic() < until:
            try:
                if self.saving.acquire(timeout=0.1):
                    return
            except KeyboardInterrupt:  # pressed again: the save is still completed
                continue

    def handle_error(self, request: object, client_address: object) -> None:
        """A closed tab is no error; anything else is said in one sentence."""
        error = sys.exception()
        if not isinstance(error, ConnectionError | TimeoutError):
            self.trouble(f"unexpected {type(error).__name__}: {error}; this is a bug")

    def _complete(self) -> None:
        """Write the masks that a killed save did not come to, and remove its unfinished files."""
        for path in self.folder.glob(".*.????????????"):
            if path.name.startswith((".mask-", f".{masks.POLYGONS}.")):
                self._remove(path)
        for name, content in masks.mask_files(self.drawing, self.frames).items():
            path = self.folder / name
            if not path.is_file() or path.read_bytes() != content:
                write_bytes(str(path), content)

    @staticmethod
    def _remove(path: Path) -> None:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise OutputError.of(str(path), error) from None


def serve(
    frames: Sequence[Frame],
    pictures: PictureOf,
    folder: str,
    *,
    port: int = 0,
    ready: Callable[[str], None] | None = None,
    saved: Callable[[list[str]], None] | None = None,
    trouble: Callable[[str], None] | None = None,
) -> None:
    """Serve the labelling page until KeyboardInterrupt, which is passed on after a running save.

    ``ready`` is called with the URL; the other parameters are those of ``LabelServer``. Raises
    UsageError if another process serves the folder.
    """
    with (
        folder_lock(folder),
        LabelServer(frames, pictures, folder, port=port, saved=saved, trouble=trouble) as server,
    ):
        try:
            if ready is not None:
                ready(server.url)
            server.serve_forever(poll_interval=0.2)
        finally:
            server.finish()


def _earlier_drawing(folder: Path, frames: Sequence[Frame]) -> masks.Drawing:
    """The polygons saved in the folder, if any; creates the folder."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(
            f"{folder}: cannot be created ({error.strerror}); choose another folder with --out"
        ) from None
    earlier = folder / masks.POLYGONS
    if earlier.exists():
        try:
            return masks.read_drawing(read_bytes(str(earlier)), frames)
        except DataError as error:
            raise DataError(f"{earlier}: {error}; choose another folder with --out") from None
    if any(folder.glob("mask-*.png")):
        raise UsageError(
            f"{folder}: holds masks that this page did not draw, expected none; "
            "choose another folder with --out"
        )
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
        """Send the page, one of its files, or a frame; refuse anything else."""
        requested = self._requested()
        if requested is None:
            return
        if requested in ("", "label.css", "label.js"):
            name = requested or "label.html"
            content = resources.files(__package__).joinpath(name).read_bytes()
            self._answer(HTTPStatus.OK, content, _CONTENT_TYPES[name.rpartition(".")[2]])
        elif requested == "state.json":
            state = masks.initial_state(self.server.frames, self.server.drawing, _label_styles())
            self._answer(HTTPStatus.OK, state, "application/json")
        elif requested in {f"frame-{i}.jpg" for i in range(len(self.server.frames))}:
            content = self._frame(int(requested[6:-4]))
            self._answer(HTTPStatus.OK, content, "image/jpeg")
        else:
            self._refuse(HTTPStatus.NOT_FOUND, "not found")

    def do_POST(self) -> None:
        """Receive polygons from the page and write the masks."""
        requested = self._requested()
        if requested is None:
            return
        length = self.headers.get("Content-Length", "")
        if requested != "save":
            self._refuse(HTTPStatus.NOT_FOUND, "not found")
        elif self.headers.get("Origin") not in {f"http://{host}" for host in self.server.hosts}:
            self._refuse(HTTPStatus.FORBIDDEN, "only the labelling page can save")
        elif self.headers.get("Content-Type") != "application/json":
            self._refuse(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "expected JSON")
        elif not length.isdecimal() or int(length) > MAX_REQUEST_BYTES:
            self._refuse(
                HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"expected at most {MAX_REQUEST_BYTES} bytes"
            )
        else:
            self._save(self.rfile.read(int(length)))

    def _save(self, content: bytes) -> None:
        with self.server.saving:
            try:
                names = self.server.save(content)
            except MssegmentError as error:
                self._refuse(HTTPStatus.BAD_REQUEST, str(error))
                return
            text = f"Saved {', '.join(names)} in {self.server.folder}"
            self._answer(HTTPStatus.OK, text.encode(), "text/plain")

    def _requested(self) -> str | None:
        """The path below the secret part of the URL; None if the request was refused."""
        if self.headers.get("Host") not in self.server.hosts:
            self._refuse(HTTPStatus.FORBIDDEN, "only requests from this machine are accepted")
            return None
        prefix = f"/{self.server.secret}/"
        path = self.path
        if not secrets.compare_digest(path[: len(prefix)].encode(), prefix.encode()):
            self._refuse(HTTPStatus.NOT_FOUND, "not found")
            return None
        return path[len(prefix) :]

    def _frame(self, index: int) -> bytes:
        """A frame as JPEG, blank if its picture is not available."""
        picture = self.server.pictures(index)
        if picture is None:
            frame = self.server.frames[index]
            picture = np.full((frame.height, frame.width, 3), 236, dtype=np.uint8)
        options = [cv2.IMWRITE_JPEG_QUALITY, 92]
        return bytes(cv2.imencode(".jpg", np.ascontiguousarray(picture), options)[1].tobytes())

    def _refuse(self, status: HTTPStatus, text: str) -> None:
        self.close_connection = True  # the rest of the request is not read
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
        """Do not log: the terminal is for the user."""


def _label_styles() -> list[dict[str, object]]:
    """Colours and glyphs of the labels."""
    return [
        {
            "label": label,
            "colour": hexadecimal(label_style(label).colour),
            "glyph": label_style(label).glyph,
        }
        for label in range(1, 57)
    ]
