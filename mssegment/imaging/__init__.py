"""Pictures in, corners and tracks out: the only room that knows OpenCV's features."""
