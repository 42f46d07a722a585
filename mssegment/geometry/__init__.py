"""Geometry that several models share, batched over leading axes."""
