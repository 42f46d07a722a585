"""Manual labels without another program: a local web page on which polygons are drawn per motion.

``server`` serves it on the loopback address only; ``masks`` turns polygons into the mask pictures
that ``report --labels`` reads. The page is ``label.html``, ``label.css`` and ``label.js``.
"""

from mssegment.labelling.server import LabelServer, serve

__all__ = ["LabelServer", "serve"]
