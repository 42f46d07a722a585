"""Signals at awkward moments: during an import, in a destructor, where a library hides them."""

from __future__ import annotations

import subprocess
import sys

import pytest

# a shell starts its background jobs with SIGINT ignored
DURING_THE_START = """
import os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
import mssegment.__main__

class Interrupting:
    def find_spec(self, name, *further):
        if name == "click":
            os.kill(os.getpid(), signal.SIGINT)

sys.modules.pop("click", None)
sys.meta_path.insert(0, Interrupting())
sys.argv = ["mssegment", "--version"]
mssegment.__main__.main()
"""
IN_A_DESTRUCTOR = """
import os, signal, sys, time
import mssegment.cli

class Lost:
    def __del__(self):
        os.kill(os.getpid(), signal.SIGTERM)
        for _ in range(1000): pass

def command(*arguments, **options):
    Lost()
    time.sleep(10)

mssegment.cli.cli.main = command
mssegment.cli.main([])
"""
HIDDEN_BY_A_LIBRARY = """
import os, signal
signal.signal(signal.SIGINT, signal.default_int_handler)
import mssegment.cli

def command(*arguments, **options):
    try:
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(1000): pass
    except BaseException:
        raise ImportError("a part of a library could not be loaded") from None

mssegment.cli.cli.main = command
mssegment.cli.main([])
"""
IGNORED = """
import os, signal
signal.signal(signal.SIGHUP, signal.SIG_IGN)
import mssegment.cli

def command(*arguments, **options):
    os.kill(os.getpid(), signal.SIGHUP)

mssegment.cli.cli.main = command
mssegment.cli.main([])
"""


@pytest.mark.parametrize(
    ("code", "status", "said"),
    [
        (DURING_THE_START, 130, "mssegment: interrupted\n"),
        (IN_A_DESTRUCTOR, 143, "mssegment: terminated\n"),
        (HIDDEN_BY_A_LIBRARY, 130, "mssegment: interrupted\n"),
        (IGNORED, 0, ""),
    ],
    ids=["start", "destructor", "library", "ignored"],
)
def test_a_signal_is_one_line_and_its_status(code: str, status: int, said: str) -> None:
    process = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (process.returncode, process.stderr) == (status, said)
