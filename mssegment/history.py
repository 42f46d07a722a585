"""The history of a document: each stage adds an entry with the settings that affect its result."""

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
"""The settings that affect the result of each stage and are recorded in its history entry."""


def entry_of(
    stage: str, configuration: Configuration | None = None, notes: tuple[str, ...] = ()
) -> HistoryEntry:
    """The history entry of a stage.

    Parameters
    ----------
    stage : str
        A key of ``STAGE_KEYS``.
    configuration : Configuration, optional
        The configuration of the stage; not needed for ``import``, which has no settings.
    notes : tuple of str
        Notes of the stage for the user.

    Returns
    -------
    HistoryEntry
    """
    settings = {key: _value(configuration, key) for key in STAGE_KEYS[stage]}
    return HistoryEntry(stage=stage, version=__version__, settings=settings, notes=notes)


def inherited(document: Document) -> list[Setting]:
    """The settings that earlier stages recorded in the document, such as the seed.

    They come before those of the command line, which override them.
    """
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
