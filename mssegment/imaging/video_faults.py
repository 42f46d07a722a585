"""Why a file is not a video that can be decoded, from the boxes of MP4 and the heads of others."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

_INSIDE = (b"moov", b"trak", b"mdia", b"minf", b"stbl")
_CODECS = {b"av01": "AV1", b"vp09": "VP9", b"hvc1": "H.265", b"hev1": "H.265", b"vvc1": "H.266"}
_CODECS |= {b"avc1": "H.264", b"mp4v": "MPEG-4"}
_HEIC = (b"heic", b"heix", b"hevc", b"hevx", b"mif1", b"msf1")
_AUDIO = (b"ID3", b"OggS", b"fLaC", b"\xff\xfb", b"\xff\xf3")


def fault_of(path: str, said: str, has_pyav: bool) -> str:
    """What is wrong with a file that no decoder opens, and what to do.

    Parameters
    ----------
    path : str
        The file.
    said : str
        What the decoder said; empty if it says nothing.
    has_pyav : bool
        Whether the decoder was PyAV, so that installing it is no advice.
    """
    try:
        with Path(path).open("rb") as file:
            return _fault(file, said, has_pyav)
    except OSError as error:
        return f"cannot be read ({error.strerror}); check the path"


def _fault(file: BinaryIO, said: str, has_pyav: bool) -> str:
    head = file.read(32)
    if head[4:8] == b"ftyp" and head[8:12] in _HEIC:
        return "a HEIC picture, which is not read; convert it to JPEG or PNG"
    if head.startswith(b"PK\x03\x04"):
        return "an archive; unpack it and name the folder"
    if head.startswith(b"version https://git-lfs"):
        return "a pointer of Git LFS; `git lfs pull` fetches the file itself"
    if head[4:8] in (b"ftyp", b"moov", b"mdat", b"wide", b"free"):
        boxes = list(_boxes(file, 0, _size(file)))
        if b"moov" not in [name for name, _ in boxes]:
            return (
                "the video is cut short (an MP4 without its index 'moov'): the recording or the "
                "copy was not finished; copy it again, or repair it from a whole file of the camera"
            )
        if boxes[-1][1][1] < _size(file):
            return "the video is cut short; copy it again"
        kinds = set(_handlers(file))
        if kinds and b"vide" not in kinds:
            return "no pictures in this file (sound only); expected a video"
        codec = next((_CODECS[name] for name in _formats(file) if name in _CODECS), "")
        if codec:
            advice = "" if has_pyav else "pip install 'mssegment[video]' for another decoder, or "
            return (
                f"a video in {codec} that this decoder cannot read; {advice}convert it: "
                "ffmpeg -i IN -c:v libx264 OUT.mp4"
            )
    if head.startswith(_AUDIO) or (head[:4] == b"RIFF" and head[8:12] == b"WAVE"):
        return "no pictures in this file (sound only); expected a video"
    if said == "no video stream":
        return "no pictures in this file; expected a video"
    reason = f" ({said})" if said else ""
    return (
        f"neither a picture nor a video that can be decoded{reason}; convert it (PNG, JPEG, MP4 "
        "and AVI work everywhere)"
    )


def _size(file: BinaryIO) -> int:
    return file.seek(0, 2)


def _boxes(file: BinaryIO, start: int, stop: int) -> Iterator[tuple[bytes, tuple[int, int]]]:
    """The boxes between two offsets: name, and where its content starts and stops."""
    while start + 8 <= stop:
        file.seek(start)
        size, name = struct.unpack(">I4s", file.read(8))
        inside = start + 8
        if size == 1:
            size = struct.unpack(">Q", file.read(8).ljust(8, b"\0"))[0]
            inside += 8
        end = stop if size == 0 else start + size
        if end <= start or end > stop:
            return
        yield name, (inside, end)
        start = end


def _find(file: BinaryIO, wanted: bytes) -> Iterator[tuple[int, int]]:
    waiting = [(0, _size(file))]
    while waiting:
        for name, place in list(_boxes(file, *waiting.pop())):
            if name == wanted:
                yield place
            elif name in _INSIDE:
                waiting.append(place)


def _handlers(file: BinaryIO) -> Iterator[bytes]:
    for start, _ in _find(file, b"hdlr"):
        file.seek(start + 8)
        yield file.read(4)


def _formats(file: BinaryIO) -> Iterator[bytes]:
    for start, _ in _find(file, b"stsd"):
        file.seek(start + 12)
        yield file.read(4)
