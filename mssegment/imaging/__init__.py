"""From pictures to corners and tracks: the only package that uses OpenCV's feature functions."""
