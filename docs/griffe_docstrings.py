"""Makes docstrings fit for Markdown before mkdocstrings renders them."""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension, Object

_ROLE = re.compile(r":(?:class|func|meth|mod|attr|data):`~?([^`]+)`")
_CODE_OR_LINK = re.compile(r"(``.+?``|`[^`\n]+`|^\s*(?:>>>|\.\.\.) .*$)|\]\[", re.M | re.S)


class MarkdownDocstrings(Extension):
    """Sphinx roles become code, and ``[3][0]`` outside of code does not become a link."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Rewrites the docstring of every object."""
        if obj.docstring is not None:
            text = _ROLE.sub(r"`\1`", obj.docstring.value)
            obj.docstring.value = _CODE_OR_LINK.sub(lambda m: m[1] or r"]\[", text)
