"""The data sets of ``mssegment benchmark``: their settings and published results."""

from __future__ import annotations

from mssegment.records import Record


class Published(Record, frozen=True):
    """A published result: the mean misclassification in percent on ``group``, as text."""

    method: str
    group: str
    mean: str
    source: str


class Benchmark(Record, frozen=True):
    """How a data set is run: common settings, settings by group, and published results."""

    dataset: str
    settings: dict[str, object]
    by_group: dict[str, dict[str, object]]
    published: tuple[Published, ...]


BENCHMARKS: dict[str, Benchmark] = {
    entry.dataset: entry
    for entry in (
        Benchmark(
            "hopkins155",
            # in this data set the background is one of the motions
            {"hypothesize.model": "factorization", "background.remove": False},
            {},
            (
                Published(
                    "RSIM (count given, 155 sequences)",
                    "all",
                    "0.79-0.89",
                    "Ji, Salzmann, Li: Shape interaction matrix revisited and robustified. "
                    "ICCV 2015",
                ),
                Published(
                    "SSC (count given, 155 sequences)",
                    "all",
                    "about 2",
                    "Elhamifar, Vidal: Sparse subspace clustering. PAMI 2013",
                ),
            ),
        ),
        Benchmark(
            "kt3dmoseg",
            {"hypothesize.model": "factorization", "background.remove": False},
            {},
            (
                Published(
                    "multi-view spectral clustering (count given, 22 clips)",
                    "all",
                    "about 8",
                    "Xu, Cheong, Li: Motion segmentation by exploiting complementary geometric "
                    "models. CVPR 2018",
                ),
            ),
        ),
        Benchmark(
            "adelaidermf",
            {"background.remove": False},
            {
                "motion": {"segment.granularity": "object", "hypothesize.model": "auto"},
                "plane": {
                    "segment.granularity": "surface",
                    "hypothesize.model": "homography",
                },
            },
            (
                Published(
                    "Progressive-X (count unknown, 19 pairs)",
                    "motion",
                    "10.9",
                    "Barath, Matas: Progressive-X. ICCV 2019",
                ),
                Published(
                    "Progressive-X (count unknown, 17 pairs)",
                    "plane",
                    "6.4",
                    "Barath, Matas: Progressive-X. ICCV 2019",
                ),
            ),
        ),
    )
}
"""The data sets of ``mssegment benchmark``, by name."""
