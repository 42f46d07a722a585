"""Configuration: precedence, and a message with the place and the nearest key for what is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mssegment.configuration import (
    KEYS,
    Configuration,
    Setting,
    camera_of,
    camera_settings,
    from_environment,
    from_file,
    from_options,
    from_text,
    resolve,
)
from mssegment.configuration.template import template
from mssegment.errors import ConfigurationError, MssegmentError, UsageError
from mssegment.records import Camera


def write(folder: Path, text: str, name: str = "config.yaml") -> str:
    path = folder / name
    path.write_text(text)
    return str(path)


def test_no_settings_are_the_defaults() -> None:
    assert resolve([]) == Configuration()


def test_option_beats_environment_beats_config_beats_default(tmp_path: Path) -> None:
    path = write(tmp_path, "seed: 1\ncluster: {bandwidth: 0.1, kernel: epanechnikov}\n")
    layers = [
        *from_file(path),
        *from_environment({"MSSEGMENT_CLUSTER_BANDWIDTH": "0.2", "MSSEGMENT_SEED": "2"}),
        *from_options({"seed": "3", "cluster.kernel": None}, {"seed": "--seed"}),
    ]
    found = resolve(layers)
    assert found.seed == 3
    assert found.cluster.bandwidth == 0.2
    assert found.cluster.kernel == "epanechnikov"
    assert found.segment == Configuration().segment


def test_every_key_can_be_set_from_the_environment() -> None:
    for key, setting in KEYS.items():
        name = f"MSSEGMENT_{key.replace('.', '_').upper()}"
        (found,) = from_environment({name: yaml.safe_dump(setting.default)})
        assert found.key == key
        resolve([found])


def test_paths_are_relative_to_the_configuration(tmp_path: Path) -> None:
    path = write(tmp_path, "input: {images: [a.png, sub/../b.png]}\ncamera: {file: c.yaml}\n")
    found = resolve(from_file(path))
    assert found.input.images == [str(tmp_path / "a.png"), str(tmp_path / "b.png")]
    assert found.camera.file == str(tmp_path / "c.yaml")


WORDS = ["yes", "true", "on", "no", "false", "off", "null", "none", "auto", "y", "inf", "nan", "e"]


@given(
    st.one_of(
        st.text("0123456789._-+eE:", min_size=1, max_size=18),
        st.sampled_from(WORDS).flatmap(
            lambda word: st.sampled_from([word, word.upper(), word.capitalize(), word.swapcase()])
        ),
        st.from_regex(r"[a-zA-Z]{1,5}", fullmatch=True),
    )
)
def test_text_means_what_yaml_says_also_where_yaml_is_not_loaded(text: str) -> None:
    try:
        expected = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError):
        with pytest.raises(ConfigurationError):
            from_text([f"input.tracks={text}"])
        return
    (found,) = from_text([f"input.tracks={text}"])
    assert type(found.value) is type(expected)
    assert found.value == expected or found.value != found.value  # nan


def test_one_path_may_stand_for_a_list() -> None:
    assert resolve(from_text(["input.images=clip.mp4"])).input.images == ["clip.mp4"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("cluster:\n  bandwith: 1\n", ":2:3: unknown key cluster.bandwith; did you mean cluster.b"),
        ("clutser:\n  bandwidth: 1\n", ":1:1: unknown key clutser"),
        (
            "cluster:\n  bandwidth: -1\n",
            ":2:3: cluster.bandwidth is -1; expected auto|NUMBER (more than 0)",
        ),
        ("cluster: {bandwidth: .nan}\n", "cluster.bandwidth is nan"),
        ("cluster: {bandwidth: .inf}\n", "cluster.bandwidth is inf"),
        ("cluster: {kernel: round}\n", "expected gaussian|truncated|epanechnikov"),
        ("hypothesize: {model: afine}\n", "hypothesize.model is 'afine'"),
        ("hypothesize: {count: 0}\n", "hypothesize.count is 0"),
        ("seed: x\n", ":1:1: seed is 'x'; expected INTEGER (at least 0)"),
        ("seed: 1\nseed: 2\n", ":2:1: seed is set twice"),
        ("cluster: 3\n", ":1:10: cluster: expected keys below it"),
        ("- a\n", ":1:1: expected keys"),
        ("seed: [1\n", "not YAML"),
        ("seed: !!python/object:os.system 1\n", "not a plain YAML value"),
        ("seed: 2001-13-45\n", "not a plain YAML value"),
        ("input: {start: 3, stop: 2}\n", "input.stop is 2; expected more than input.start (3)"),
        ("segment: {motions: 1, min_motions: 2}\n", "expected at least segment.min_motions"),
    ],
)
def test_what_is_wrong_in_a_file_is_said_in_one_line(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(ConfigurationError) as caught:
        resolve(from_file(write(tmp_path, text)))
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_configuration_says_how_to_get_one(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="`mssegment init` writes one"):
        from_file(str(tmp_path / "none.yaml"))


def test_a_wrong_set_is_a_configuration_error_and_a_wrong_option_a_usage_error() -> None:
    for text in ("cluster.bandwidth", "cluster.bandwdth=1", "cluster.bandwidth=x", "seed=[1"):
        with pytest.raises(ConfigurationError, match="--set"):
            resolve(from_text([text]))
    with pytest.raises(UsageError, match="--seed: seed is 'x'"):
        resolve(from_options({"seed": "x"}, {"seed": "--seed"}))


@given(st.text(max_size=80))
def test_any_text_is_read_or_refused_in_one_line(text: str) -> None:
    try:
        resolve([*from_text([text]), *from_text([f"seed={text}"])])
    except MssegmentError as error:
        message = str(error).replace(text, "")
        assert "Traceback" not in message


@pytest.mark.parametrize("model", ["affine", "translation", "factorization", "homography", "auto"])
def test_the_template_names_every_key_and_is_the_defaults(tmp_path: Path, model: str) -> None:
    found = from_file(write(tmp_path, template(model)))
    assert [setting.key for setting in found] == list(KEYS)
    configuration = resolve(found)
    assert configuration.hypothesize.model == model
    changed = {"input.images", "hypothesize.model", "camera.file"}
    for setting in found:
        if setting.key not in changed:
            assert setting.value == KEYS[setting.key].default


def test_every_key_has_a_sentence_and_choices() -> None:
    for setting in KEYS.values():
        assert setting.description.endswith(".")
        assert setting.choices


def test_the_camera_comes_from_numbers_or_a_file(tmp_path: Path) -> None:
    path = write(tmp_path, "fx: 700\nfy: 710\ncx: 320\ncy: 240\ndistortion: [0.1]\n")
    as_json = write(tmp_path, '{"fx": 700, "fy": 710, "cx": 320, "cy": 240}', "camera.json")
    assert camera_of(resolve([]).camera) is None
    plain = Camera(700, 710, 320, 240)
    assert camera_of(resolve(camera_settings("700,710,320,240")).camera) == plain
    assert camera_of(resolve(camera_settings(as_json)).camera) == plain
    assert camera_of(resolve(camera_settings(path)).camera) == Camera(700, 710, 320, 240, (0.1,))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1,2,3", "found 3 numbers; expected fx,fy,cx,cy"),
        ("1,2,3,x", "camera.cy is 'x'"),
        ("-1,2,3,4", "camera.fx is -1"),
        ("none.yaml", "no such camera file"),
    ],
)
def test_a_camera_that_is_none_is_said(text: str, said: str) -> None:
    with pytest.raises(MssegmentError, match=said):
        camera_of(resolve(camera_settings(text)).camera)


def test_a_camera_file_that_holds_none_is_said(tmp_path: Path) -> None:
    for text, said in (
        ("fx: 1\n", "camera.fy is missing"),
        ("fx: 1\nfy: 1\ncx: 1\ncy: 1\ndistorion: [1]\n", "unknown key distorion; did you mean"),
        ("file: other.yaml\n", "no camera in this file, found the keys file"),
        ("7\n", "expected fx, fy, cx, cy"),
        ("fx: 1\nfy: -1\ncx: 1\ncy: 1\n", "fy is -1; expected more than 0"),
        ("fx: [1\n", "not YAML"),
        ("", "empty"),
    ):
        path = write(tmp_path, text)
        with pytest.raises(ConfigurationError, match=said):
            camera_of(resolve([Setting("camera.file", path, "test")]).camera)
    both = [Setting("camera.file", "a.yaml", "test"), Setting("camera.fx", 3.0, "test")]
    with pytest.raises(ConfigurationError, match=r"camera.file and camera.fx are both set"):
        camera_of(resolve(both).camera)


def test_a_number_with_an_exponent_is_a_number() -> None:
    # YAML 1.1 reads 1e-2 as text
    assert resolve(from_text(["cluster.bandwidth=1e-2"])).cluster.bandwidth == 0.01


def test_the_descriptions_state_the_automatic_values_that_the_program_uses() -> None:
    from mssegment.imaging import corners
    from mssegment.imaging.matching import klt
    from mssegment.sampling.strategy import CONSENSUS_FRAMES, LONG_SEQUENCE

    for key, phrase in (
        ("detect.levels", f"auto: {corners.LEVELS_TWO_VIEWS} or more for two views"),
        (
            "detect.max_corners",
            f"auto: {corners.LIMIT_TWO_VIEWS} for two views, otherwise {corners.LIMIT_SEQUENCE}.",
        ),
        ("detect.quality", f"auto: {corners.QUALITY:.4f}."),
        ("detect.min_distance", f"otherwise {corners.DISTANCE_SEQUENCE:g}."),
        (
            "match.min_length",
            f"up to {corners.FEW_FRAMES} frames, otherwise {klt.MIN_TRACK_LENGTH}.",
        ),
        ("cluster.method", f"factorization over {CONSENSUS_FRAMES} frames or more"),
        ("hypothesize.rank", f"fewer than {LONG_SEQUENCE} frames"),
    ):
        assert phrase in KEYS[key].description


def test_a_variable_of_no_setting_is_named() -> None:
    wrong = {"MSSEGMENT_CLUSTER_BANDWITH": "0.1"}
    with pytest.raises(
        ConfigurationError,
        match=r"MSSEGMENT_CLUSTER_BANDWITH.*did you mean MSSEGMENT_CLUSTER_BANDW",
    ):
        from_environment(wrong)
    assert from_environment({"MSSEGMENT_DATA": "x", "_MSSEGMENT_COMPLETE": "y"}) == []


def test_escaped_halves_of_a_character_are_joined(tmp_path: Path) -> None:
    path = tmp_path / "c.yaml"
    path.write_text(json.dumps({"input": {"tracks": "\U0001f600.csv"}}))
    (tracks,) = from_file(str(path))
    assert tracks.value == str(tmp_path / "\U0001f600.csv")
    path.write_text('{"input": {"tracks": "a\\ud83d.csv"}}')
    with pytest.raises(ConfigurationError, match="half a character"):
        from_file(str(path))
