"""The page of a long clip: one HTML file with some of its frames, a time line and the objects."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape

import cv2

from mssegment.documents.clips import ClipDocument, ClipObject
from mssegment.rendering.clip_tables import clip_summary, objects_table, periods
from mssegment.rendering.report import Picture
from mssegment.rendering.style import hexadecimal, label_style
from mssegment.version import __version__

ROW = 16
"""Height of the line of an object, pixels."""
LINE = 900
"""Length of the time line, pixels."""
JPEG_QUALITY = 80
_STYLE = """
:root{color-scheme:light dark}
body{font:16px/1.5 system-ui,sans-serif;max-width:70rem;margin:2rem auto;padding:0 1rem}
.frames{display:grid;grid-template-columns:repeat(auto-fill,minmax(20rem,1fr));gap:.7rem}
figure{margin:0}img,svg{max-width:100%;height:auto}
figcaption,.quiet{font-size:.85rem;opacity:.75}
table{border-collapse:collapse}td,th{text-align:left;padding:.15rem .9rem .15rem 0}
text{font:11px system-ui,sans-serif;fill:currentColor}
"""


def render_clip_page(
    document: ClipDocument, stills: Sequence[tuple[int, bytes]], video: str | None = None
) -> str:
    """The page as text.

    Parameters
    ----------
    document : ClipDocument
        The clip.
    stills : sequence of (int, bytes)
        The numbers of some frames, and these annotated, as JPEG.
    video : str, optional
        The name of the annotated video beside the page.
    """
    title = f"{clip_summary(document)} · {document.inputs[0].rpartition('/')[2]}"
    figures = "".join(_figure(number, content) for number, content in stills)
    link = f'<p><a href="{escape(video)}">{escape(video)}</a></p>' if video else ""
    table = objects_table(document)
    header = "".join(f"<th>{escape(cell)}</th>" for cell in table.header)
    rows = "".join(
        "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in table.rows
    )
    page = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width">'
        '<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; img-src data:; '
        "style-src 'unsafe-inline'\">"
        f"<title>{escape(title)}</title><style>{_STYLE}</style></head><body>\n"
        f"<h1>{escape(clip_summary(document))}</h1>\n{link}<h2>When each object is seen</h2>\n"
        f'{timeline(document)}\n<h2>Frames</h2>\n<div class="frames">{figures}</div>\n'
        f"<h2>Objects</h2>\n<table><thead><tr>{header}</tr></thead><tbody>{rows}</tbody></table>\n"
        f'<p class="quiet">{escape(", ".join(document.inputs[:3]))}; {document.width} x '
        f"{document.height} pixels; mssegment {escape(__version__)}</p></body></html>\n"
    )
    # bytes of a file name that are no text become question marks
    return page.encode("utf-8", "replace").decode("utf-8")


def timeline(document: ClipDocument) -> str:
    """An SVG with a line for each object: full where it moves, thin where it stands still."""
    left, scale = 60, LINE / max(1, document.frames)
    height = ROW * (len(document.whole_objects) + 1)
    parts = [
        f'<svg viewBox="0 0 {left + LINE + 10} {height}" width="{left + LINE + 10}" role="img" '
        'aria-label="From which frame to which each object is seen">'
    ]
    for row, one in enumerate(document.whole_objects):
        parts.append(_line(one, ROW * row, left, scale))
    for tick in range(5):
        frame = round(tick * (document.frames - 1) / 4)
        anchor = "start" if tick == 0 else "end" if tick == 4 else "middle"
        x = left + frame * scale
        parts.append(f'<text x="{x:.1f}" y="{height - 4}" text-anchor="{anchor}">{frame}</text>')
    return "".join([*parts, "</svg>"])


def _line(one: ClipObject, top: int, left: int, scale: float) -> str:
    name = str(one.identity) if one.identity else "camera"
    colour = hexadecimal(label_style(one.identity).colour) if one.identity else "#94a3b8"
    parts = [f'<text x="0" y="{top + 12}">{name}</text>']
    for spans, y, thick in ((one.resting, top + 6, 4), (one.moving, top + 3, 10)):
        for first, last in spans:
            x, width = left + first * scale, max(1.5, (last - first + 1) * scale)
            parts.append(
                f'<rect x="{x:.1f}" y="{y}" width="{width:.1f}" height="{thick}" fill="{colour}">'
                f"<title>{name}: {periods([(first, last)])}</title></rect>"
            )
    return "".join(parts)


def encode_jpeg(picture: Picture) -> bytes:
    """A picture in BGR order as JPEG."""
    done, content = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    assert done
    return content.tobytes()


def _figure(number: int, content: bytes) -> str:
    address = base64.b64encode(content).decode()
    return (
        f'<figure><img src="data:image/jpeg;base64,{address}" alt="Frame {number}">'
        f"<figcaption>frame {number}</figcaption></figure>"
    )
