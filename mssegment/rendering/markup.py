"""Text of documents in HTML and SVG."""

from __future__ import annotations

import html

from mssegment.inputs.text import printable


def escape(text: str) -> str:
    """Text for HTML and XML: markup and invisible characters, such as direction marks, as escapes.

    Examples
    --------
    >>> escape("a<b\x1b[31m")
    'a&lt;b\\\\u001b[31m'
    """
    return html.escape(printable(text))
