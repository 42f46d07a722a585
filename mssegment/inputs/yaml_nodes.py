"""What PyYAML lets through: aliases that expand to a billion values, and halves of characters."""

from __future__ import annotations

import yaml

from mssegment.errors import MssegmentError
from mssegment.inputs import limits


def check_text(text: str, where: str, error: type[MssegmentError]) -> None:
    """Check how many values a text can have, before the slow parser sees it.

    Raises ``error`` if it has more commas and lines than ``limits.yaml_values``.
    """
    limits.check("yaml_values", text.count(",") + text.count("\n"), where, error)


def check_nodes(root: yaml.Node | None, where: str, error: type[MssegmentError]) -> None:
    """Check how much a YAML document becomes, and put its characters together.

    JSON escapes a character beyond U+FFFF as two halves, which PyYAML takes as two characters.

    Parameters
    ----------
    root : yaml.Node or None
        The composed document; None if it is empty.
    where : str
        The file or option, which opens the message.
    error : type
        The error to raise.

    Raises
    ------
    MssegmentError
        ``error``, if an alias contains itself, the document has more values than
        ``limits.yaml_values`` after its aliases are expanded, or a text has half a character.
    """
    sizes: dict[int, int | None] = {}
    waiting = [] if root is None else [root]
    while waiting:  # no recursion: documents may be deep
        node = waiting[-1]
        children = _children(node)
        if id(node) not in sizes:
            sizes[id(node)] = None
            waiting += [child for child in children if id(child) not in sizes]
            if any(sizes.get(id(child), 0) is None for child in children):
                raise error(f"{where}: an alias that contains itself; write the value out")
            continue
        waiting.pop()
        if isinstance(node, yaml.ScalarNode):
            node.value = _whole(node.value, where, error)
        if sizes[id(node)] is None:
            size = 1 + sum(sizes[id(child)] or 1 for child in children)
            limits.check("yaml_values", size, where, error)
            sizes[id(node)] = size


def _whole(text: str, where: str, error: type[MssegmentError]) -> str:
    """The text with the halves of characters joined."""
    if text.isascii():
        return text
    try:
        return text.encode("utf-16", "surrogatepass").decode("utf-16")
    except UnicodeDecodeError:
        shown = ascii(text[:40])
        raise error(f"{where}: half a character in {shown}; write it in UTF-8") from None


def _children(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [part for pair in node.value for part in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []
