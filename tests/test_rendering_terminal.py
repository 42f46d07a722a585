"""Pictures in the terminal: decoded again by what the protocols say."""

from __future__ import annotations

import base64
import re

import cv2
import numpy as np
import pytest

from mssegment.rendering.terminal import protocol_of, show


@pytest.fixture
def picture():
    image = np.zeros((20, 30, 3), dtype=np.uint8)
    image[:8, :10] = (255, 0, 0)
    image[8:, 12:] = (0, 255, 255)
    return image


@pytest.mark.parametrize(
    ("environment", "protocol"),
    [
        ({"TERM": "xterm-kitty"}, "kitty"),
        ({"TERM": "xterm-256color", "TERM_PROGRAM": "WezTerm"}, "kitty"),
        ({"TERM": "xterm-256color", "TERM_PROGRAM": "iTerm.app"}, "iterm"),
        ({"TERM": "foot"}, "sixel"),
        ({"TERM": "xterm-256color"}, None),
        ({"TERM": "xterm-kitty", "TMUX": "/tmp/x"}, None),
        ({"TERM": "dumb"}, None),
        ({}, None),
    ],
)
def test_what_a_terminal_can_do(environment, protocol):
    assert protocol_of(environment) == protocol


def test_kitty_sends_the_png_in_pieces():
    noise = np.random.default_rng(0).integers(0, 256, (60, 60, 3), dtype=np.uint8)
    pieces = re.findall(rb"\x1b_G([^;]*);([^\x1b]*)\x1b\\", show(noise, "kitty"))
    assert pieces[0][0].startswith(b"a=T,f=100,m=1")
    assert pieces[-1][0] == b"m=0"
    assert all(len(chunk) <= 4096 for _, chunk in pieces)
    png = base64.b64decode(b"".join(chunk for _, chunk in pieces))
    assert np.array_equal(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR), noise)


def test_iterm_sends_the_png(picture):
    encoded = show(picture, "iterm").split(b":", 1)[1].rstrip(b"\x07\n")
    png = np.frombuffer(base64.b64decode(encoded), np.uint8)
    assert np.array_equal(cv2.imdecode(png, cv2.IMREAD_COLOR), picture)


def decode_sixel(content):
    text = content.decode("ascii")
    width, height = map(int, re.search(r'"1;1;(\d+);(\d+)', text).groups())
    palette = {
        int(n): [round(int(p) * 2.55) for p in percent.split(";")]
        for n, percent in re.findall(r"#(\d+);2;(\d+;\d+;\d+)", text)
    }
    body = re.sub(r"#\d+;2;\d+;\d+;\d+", "", text.split(f"{width};{height}", 1)[1])
    image = np.zeros((height + 6, width, 3), dtype=np.uint8)
    for top, band in enumerate(body.split("\x1b")[0].split("-")):
        for line in filter(None, band.split("$")):
            number, runs = re.match(r"#(\d+)(.*)", line).groups()
            column = 0
            for count, sign in re.findall(r"(?:!(\d+))?([?-~])", runs):
                for _ in range(int(count or 1)):
                    for bit in range(6):
                        if (ord(sign) - 63) >> bit & 1:
                            image[6 * top + bit, column] = palette[int(number)]
                    column += 1
            assert column == width
    return image[:height, :, ::-1]


def test_sixel_says_the_picture(picture):
    assert np.array_equal(decode_sixel(show(picture, "sixel")), picture)


def test_wide_pictures_are_shrunk():
    wide = np.zeros((10, 2000, 3), dtype=np.uint8)
    assert b'"1;1;800;4' in show(wide, "sixel")


def test_unknown_protocols_are_named(picture):
    with pytest.raises(ValueError, match="telex"):
        show(picture, "telex")
