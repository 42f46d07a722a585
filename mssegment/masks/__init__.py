"""Dense masks: the motion of every pixel of every frame.

A pixel belongs to the motion that warps it best onto the neighbouring frames (``evidence``, with
the fields of ``fields``); colours and edges complete that where pictures are plain or covered
(``cut``). Loading this package costs no more than OpenCV; SciPy is loaded when masks are made.
"""

from __future__ import annotations

from mssegment.masks.dense import UNKNOWN, label_pixels

__all__ = ["UNKNOWN", "label_pixels"]
