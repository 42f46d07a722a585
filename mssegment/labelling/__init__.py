"""Manual labels without another program: a local page on which one draws polygons per motion.

``server`` serves it on the loopback address only, ``masks`` turns polygons into the mask pictures
that ``report --labels`` reads. ``label.html``, ``label.css`` and ``label.js`` are the page.
"""

from mssegment.labelling.server import LabelServer, serve

__all__ = ["LabelServer", "serve"]
