"""Model ``translation`` on real streets: labelled tracks of KT3DMoSeg, the number unknown."""

import numpy as np
import pytest

from mssegment import pipeline
from mssegment.configuration import from_text, resolve
from mssegment.datasets import read
from mssegment.documents import TracksDocument
from mssegment.evaluation import evaluate
from mssegment.records import Camera, Frame, Tracks

KITTI = Camera(721.5377, 721.5377, 609.5593, 172.854)


@pytest.mark.parametrize(
    ("clip", "frames", "motions"),
    [("Seq009_Clip03", (1, 6), 4), ("Seq013_Clip01", (1, 6), 2), ("Seq020_Clip01", (3, 6), 2)],
)
def test_cars_are_separated_from_the_street(data_folder, clip, frames, motions):
    path = data_folder / "kt3dmoseg" / "tracks" / f"{clip}_Tracks.mat"
    if not path.exists():
        pytest.skip("KT3DMoSeg is not available")
    read_tracks = read(str(path)).tracks
    points = read_tracks.points[:, [f - 1 for f in frames]]
    seen = np.isfinite(points).all(axis=(1, 2)) & (read_tracks.labels >= 0)
    frame_list = [Frame(name, 1242, 375) for name in "ab"]
    document = TracksDocument(frames=frame_list, camera=KITTI, tracks=Tracks(points[seen]))
    configuration = resolve(from_text(["hypothesize.model=translation"]))
    found = pipeline.cluster(pipeline.hypothesize(document, configuration), configuration)
    assert len(found.motions) == motions
    assert evaluate(found.labels, read_tracks.labels[seen]).misclassification < 0.03
