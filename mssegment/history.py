"""How a document came about: each stage leaves an entry with the settings that it used."""

from __future__ import annotations

from typing import Any

from mssegment.configuration import KEYS, Configuration, Setting
from mssegment.documents import Document, HistoryEntry
from mssegment.version import __version__

STAGE_KEYS: dict[str, tuple[str, ...]] = {
    "import": (),
    "detect": tuple(key for key in KEYS if key.startswith("detect.")),
    "match": tuple(key for key in KEYS if key.startswith("match.")),
    "hypothesize": (
        "seed",
        "camera.derotate",
        *(key for key in KEYS if key.startswith(("background.", "hypothesize."))),
        "cluster.method",
        "segment.selection",
    ),
    "cluster": ("seed", *(key for key in KEYS if key.startswith(("cluster.", "segment.")))),
}
"""The settings that change the result of a stage; its entry records them."""


def entry_of(
    stage: str, configuration: Configuration | None = None, notes: tuple[str, ...] = ()
) -> HistoryEntry:
    """The entry of a stage that ran with this configuration; ``import`` has none."""
    settings = {key: _value(configuration, key) for key in STAGE_KEYS[stage]}
    return HistoryEntry(stage=stage, version=__version__, settings=settings, notes=notes)


def inherited(document: Document) -> list[Setting]:
    """The settings that earlier stages recorded in the document, such as the seed."""
    return [
        Setting(key, value, f"the {document.kind} document")
        for entry in document.history
        for key, value in entry.settings.items()
        if key in KEYS
    ]


def _value(configuration: Any, key: str) -> Any:
    """The value of a dotted key."""
    value = configuration
    for name in key.split("."):
        value = getattr(value, name)
    return value
