"""Before sampling: the static background, and the rotation of the camera."""
