"""mot.txt: boxes of the moving objects in the form of MOTChallenge."""

from __future__ import annotations

import numpy as np

from mssegment.export import Export
from mssegment.export.objects import sightings
from mssegment.rendering.report import Report


def _content(report: Report) -> bytes:
    """Lines ``frame,id,left,top,width,height,confidence,x,y,z``; frames and pixels count from 1.

    The three last numbers, a position in space, are -1: not known.
    """
    labels = np.array([motion.label for motion in report.objects], dtype=np.int64)
    lines = []
    for seen in sightings(report, labels):
        left, top, right, bottom = seen.box
        box = f"{left + 1:.2f},{top + 1:.2f},{right - left:.2f},{bottom - top:.2f}"
        lines.append(f"{seen.frame + 1},{seen.label},{box},1,-1,-1,-1\n")
    return "".join(lines).encode()


MOT = Export("mot.txt", "boxes as in MOTChallenge", _content)
