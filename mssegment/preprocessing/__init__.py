"""Before hypotheses are drawn: the static background, the rotation of the camera."""
