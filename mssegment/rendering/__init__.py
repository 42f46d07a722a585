"""Tables, annotated pictures, videos and the HTML page.

``report`` gathers what is to be shown and is the only input of the others: ``tables`` are plain
strings, ``pictures`` are scenes (``scene``) that ``raster`` and ``svg`` paint, ``page`` is one HTML
file, ``labelling`` the local page on which a person labels, ``compare`` several results side by
side. Colours, shapes and line widths live in ``style`` and nowhere else.

Nothing is imported here: each command loads only what it draws.
"""
