"""Completion in the shell: commands, options, and what their values may be."""

from __future__ import annotations

import shutil
import subprocess

import pytest
from click.shell_completion import ShellComplete

from mssegment.cli import COMMANDS, cli, invoke
from mssegment.cli.common import FORMATS
from mssegment.configuration import KEYS
from mssegment.registry import MODELS


def completions(*words: str) -> list[str]:
    """What the last word completes to."""
    complete = ShellComplete(cli, {}, "mssegment", "_MSSEGMENT_COMPLETE")
    return [item.value for item in complete.get_completions(list(words[:-1]), words[-1])]


def kinds(*words: str) -> set[str]:
    complete = ShellComplete(cli, {}, "mssegment", "_MSSEGMENT_COMPLETE")
    return {item.type for item in complete.get_completions(list(words[:-1]), words[-1])}


def test_commands_options_and_values() -> None:
    assert completions("") == list(COMMANDS)
    assert "--model" in completions("run", "--mo")
    assert completions("run", "--model", "") == ["auto", *MODELS]
    assert completions("run", "--model", "aff") == ["affine"]
    assert completions("report", "--format", "") == list(FORMATS)
    assert completions("cluster", "--kernel", "ga") == ["gaussian"]


def test_every_key_of_set_completes_with_its_values() -> None:
    found = completions("run", "--set", "")
    assert {text.partition("=")[0] for text in found} == set(KEYS)
    assert completions("run", "--set", "cluster.ker") == [
        f"cluster.kernel={kernel}" for kernel in ("gaussian", "truncated", "epanechnikov")
    ]
    assert "seed=" in found


def test_files_complete_to_files() -> None:
    for words in (("run", ""), ("run", "--labels", ""), ("cluster", ""), ("run", "--camera", "")):
        assert kinds(*words) == {"file"}


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_of_each_shell(shell: str, capfd: pytest.CaptureFixture[str]) -> None:
    if shell == "bash" and shutil.which("bash") is None:
        pytest.skip("no bash, whose version click asks for")
    assert invoke(["completion", shell]) == 0
    script = capfd.readouterr().out
    assert "_MSSEGMENT_COMPLETE" in script
    if shutil.which(shell):
        check = subprocess.run([shell, "-n"], input=script, text=True, capture_output=True)
        assert check.returncode == 0, check.stderr
