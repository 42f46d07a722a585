"""One-line summaries of documents, for the progress lines."""

from __future__ import annotations

from mssegment.documents import (
    CornersDocument,
    Document,
    HypothesesDocument,
    SegmentationDocument,
    TracksDocument,
)


def describe(document: Document) -> str:
    """Summarize a document in one line, for example ``78 modes, 3 motions``."""
    match document:
        case CornersDocument():
            return _corners(document)
        case TracksDocument():
            count, frames, d = document.tracks.points.shape
            if not document.of_pictures:
                kind = "points" if frames == 1 else "matched points"
                return f"{count} {kind} with {d} coordinate{'s' * (d != 1)}"
            return f"{count} matches" if frames == 2 else f"{count} tracks over {frames} frames"
        case HypothesesDocument():
            return _hypotheses(document)
        case SegmentationDocument():
            modes, motions = len(document.modes), len(document.motions)
            noun = "motion" if document.of_pictures else "structure"
            return f"{modes} mode{'s' * (modes != 1)}, {motions} {noun}{'s' * (motions != 1)}"
    raise TypeError(type(document).__name__)


def _corners(document: CornersDocument) -> str:
    counts = [len(corners.points) for corners in document.corners]
    if len(counts) <= 3:
        return f"{' + '.join(str(count) for count in counts)} corners"
    return f"{sum(counts)} corners in {len(counts)} frames"


def _hypotheses(document: HypothesesDocument) -> str:
    if not document.sets:
        return "no hypotheses"
    kept = sum(len(chosen.points) for chosen in document.sets)
    drawn = sum(chosen.drawn for chosen in document.sets)
    return f"{kept} hypotheses from {drawn} subsets"
