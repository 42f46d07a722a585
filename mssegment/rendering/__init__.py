"""Tables, annotated pictures, videos and the HTML page of a segmentation.

``report`` gathers what is shown and is the only input of the other modules. ``tables`` gives
plain strings; ``pictures`` composes scenes (``scene``), which ``raster`` and ``svg`` draw; ``page``
writes one HTML file; ``compare`` puts several results side by side. Colours, shapes and line
widths are defined in ``style`` alone.

Nothing is imported here, so that each command loads only what it draws.
"""
