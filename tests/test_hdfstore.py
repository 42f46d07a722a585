"""Tables of pandas in HDF5, as pandas itself writes them."""

import pickle
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mssegment import datasets
from mssegment.errors import DataError
from mssegment.records import Floats

h5py = pytest.importorskip("h5py")


@pytest.fixture
def pandas() -> Any:
    pytest.importorskip("tables")
    return pytest.importorskip("pandas")


@pytest.fixture
def points() -> Floats:
    return np.random.default_rng(0).uniform(0.0, 400.0, (5, 4, 2)).round(2)


def sightings(pandas: Any, points: Floats) -> Any:
    """A data frame as trackpy has it."""
    tracks, frames = points.shape[:2]
    return pandas.DataFrame(
        {
            "y": points[..., 1].ravel(),
            "x": points[..., 0].ravel(),
            "mass": 1.0,
            "frame": np.tile(np.arange(frames), tracks),
            "particle": np.repeat(np.arange(tracks), frames),
        }
    )


@pytest.mark.parametrize("form", ["fixed", "table", "data columns"])
def test_a_data_frame(form: str, pandas: Any, points: Floats, tmp_path: Path) -> None:
    path = tmp_path / "tracks.h5"
    sightings(pandas, points).to_hdf(
        path,
        key="some/where",
        format="fixed" if form == "fixed" else "table",
        data_columns=True if form == "data columns" else None,
    )
    found = datasets.read(path)
    np.testing.assert_array_equal(found.tracks.points, points)
    assert found.notes == ("column ignored: mass",)


def test_text_in_rows_is_read_and_pickled_text_is_refused(
    pandas: Any, points: Floats, tmp_path: Path
) -> None:
    table = sightings(pandas, points)
    table["particle"] = [f"bead {k}" for k in table["particle"]]
    table.to_hdf(tmp_path / "rows.h5", key="a", format="table")
    found = datasets.read(tmp_path / "rows.h5")
    assert found.ids is not None
    assert found.ids[0] == "bead 0"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # pandas warns that it pickles
        table.to_hdf(tmp_path / "blocks.h5", key="a")
    with pytest.raises(DataError, match=r"blocks.h5: the column particle .* text .*to_csv"):
        datasets.read(tmp_path / "blocks.h5")


def test_frames_of_trackpy_are_joined_in_their_order(
    pandas: Any, points: Floats, tmp_path: Path
) -> None:
    points = np.tile(points, (1, 3, 1))  # twelve frames: Frame_2 comes before Frame_10
    table = sightings(pandas, points)
    with pandas.HDFStore(tmp_path / "store.h5", "w") as store:
        for frame, own in table.groupby("frame"):
            store.put(f"Frame_{frame}", own, format="table", track_times=False)
    np.testing.assert_array_equal(datasets.read(tmp_path / "store.h5").tracks.points, points)


def test_one_of_several_is_named(pandas: Any, points: Floats, tmp_path: Path) -> None:
    path = tmp_path / "two.h5"
    table = sightings(pandas, points)
    table.to_hdf(path, key="linked")
    table.drop(columns="particle").to_hdf(path, key="features")
    with pytest.raises(DataError, match=r"two.h5#NAME, NAME one of features, linked"):
        datasets.read(path)
    np.testing.assert_array_equal(datasets.read(f"{path}#linked").tracks.points, points)


@pytest.mark.parametrize("form", ["fixed", "table"])
@pytest.mark.parametrize("individuals", [False, True])
def test_deeplabcut(
    form: str, individuals: bool, pandas: Any, points: Floats, tmp_path: Path
) -> None:
    parts = ["snout", "left ear", "right ear", "tail", "back"]
    levels: list[list[str]] = [["DLC_resnet50"], parts, ["x", "y", "likelihood"]]
    if individuals:
        levels = [["DLC_resnet50"], ["mouse"], parts, ["x", "y", "likelihood"]]
    sure = np.ones((*points.shape[:2], 1))
    sure[1, 2] = 0.1
    rows = np.concatenate([points, sure], axis=2).transpose(1, 0, 2).reshape(points.shape[1], -1)
    table = pandas.DataFrame(rows, columns=pandas.MultiIndex.from_product(levels))
    table.to_hdf(tmp_path / "dlc.h5", key="df_with_missing", format=form)
    found = datasets.read(tmp_path / "dlc.h5")
    expected = points.copy()
    expected[1, 2] = np.nan
    np.testing.assert_array_equal(found.tracks.points, expected)
    assert found.ids == tuple(f"mouse {part}" if individuals else part for part in parts)


class Opens:
    """What a hostile file would have the unpickler call."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, tuple[str, str]]:
        return open, (str(self.path), "w")


def test_a_pickle_in_the_file_runs_nothing(tmp_path: Path) -> None:
    target = tmp_path / "made"
    path = tmp_path / "hostile.h5"
    with h5py.File(path, "w") as file:
        group = file.create_group("tracks")
        group.attrs["pandas_type"] = np.bytes_(b"frame_table")
        rows = np.zeros(3, dtype=[("index", "<i8"), ("values_block_0", "<f8", (2,))])
        table = group.create_dataset("table", data=rows)
        names = pickle.dumps([Opens(target)], protocol=0)
        table.attrs["values_block_0_kind"] = np.bytes_(names)
    with pytest.raises(DataError, match=r"hostile.h5: not a readable HDF5 file .*and no text"):
        datasets.read(path)
    assert not target.exists()


@pytest.mark.parametrize("place", [[0, 7], [0, -1], [0.0, 1.0], [[0, 1]]])
def test_names_that_point_outside_of_their_list(place: list[Any], tmp_path: Path) -> None:
    path = tmp_path / "damaged.h5"
    with h5py.File(path, "w") as file:
        file["a/block0_values"] = np.zeros((3, 2))
        file["a/block0_items_level0"] = np.array([b"x"])
        file["a/block0_items_label0"] = np.array(place)
    with pytest.raises(DataError, match=r"damaged.h5: holds .*block0_values"):
        datasets.read(path)
