"""YAML whose aliases expand to more than it says: nine lines can be a billion values."""

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
    """Check how much a YAML document becomes.

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
        ``error``, if an alias contains itself, or the document has more values than
        ``limits.yaml_values`` after its aliases are expanded.
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
        if sizes[id(node)] is None:
            size = 1 + sum(sizes[id(child)] or 1 for child in children)
            limits.check("yaml_values", size, where, error)
            sizes[id(node)] = size


def _children(node: yaml.Node) -> list[yaml.Node]:
    if isinstance(node, yaml.MappingNode):
        return [part for pair in node.value for part in pair]
    return list(node.value) if isinstance(node, yaml.SequenceNode) else []
