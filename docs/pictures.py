"""Regenerate the pictures of the README from the sample scenes: ``python -m docs.pictures``."""

from __future__ import annotations

from pathlib import Path

from mssegment import pipeline
from mssegment.configuration import from_file, resolve
from mssegment.rendering.pictures import render_pictures
from mssegment.results import Results

ROOT = Path(__file__).parents[1]
MODELS = ("translation", "factorization", "affine")


def main() -> None:
    """Write docs/pictures/<model>.jpg: all tracks beside the motions found in them."""
    folder = ROOT / "docs" / "pictures"
    folder.mkdir(exist_ok=True)
    for model in MODELS:
        configuration = resolve(from_file(str(ROOT / "configs" / f"{model}.yaml")))
        result = pipeline.run(configuration)
        report = Results.of(result.segmentation, configuration, result.source).report
        (content,) = render_pictures(report, "jpg", ["side-by-side"]).values()
        (folder / f"{model}.jpg").write_bytes(content)
        print(folder / f"{model}.jpg")


if __name__ == "__main__":
    main()
