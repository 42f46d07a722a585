"""Folders of results: whole or not there after any kill, one writer, nothing of the user lost."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest

from mssegment.documents import write_bytes
from mssegment.errors import UsageError
from mssegment.folders import exchange, result_folder, sweep

OLD = {"report.json": "old", "gone.png": "old", "masks/1.png": "old", "mine.txt": "my own"}
"""Files of an earlier run, of which two are stale, and one of the user."""
STALE = ["gone.png", "masks/1.png", "report.json"]
NEW = {"report.json": "new", "masks/2.png": "new"}
AFTER = NEW | {"mine.txt": "my own"}


def fill(folder: Path, files: dict[str, str]) -> None:
    for name, text in files.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(str(path), text.encode())


def content(folder: Path) -> dict[str, str]:
    return {
        str(path.relative_to(folder)): path.read_text()
        for path in folder.rglob("*")
        if path.is_file()
    }


def write_new(
    out: Path,
    replace: bool = True,
    error: type[BaseException] | None = None,
    key: str | None = None,
) -> bool:
    """Write the new files; whether what was there was resumed."""
    with result_folder(str(out), replace=replace, key=key) as folder:
        fill(folder.path, NEW)
        folder.stale += STALE
        if error is not None:
            (folder.path / ".1.json.0123456789ab").write_text("half")
            raise error
    return folder.resumed


@pytest.fixture
def out(tmp_path: Path) -> Path:
    return tmp_path / "results" / "out"


def test_a_folder_appears_whole(out: Path) -> None:
    with result_folder(str(out)) as folder:
        fill(folder.path, NEW)
        assert not out.exists()
    assert content(out.parent) == {f"out/{name}": text for name, text in NEW.items()}


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_an_error_leaves_what_was_there(error: type[BaseException], tmp_path: Path) -> None:
    out = tmp_path / "new" / "out"
    for before in ({}, OLD):
        fill(out, before)
        with pytest.raises(error):
            write_new(out, error=error)
        assert content(tmp_path) == {f"new/out/{name}": text for name, text in before.items()}
        assert before or not list(tmp_path.iterdir())


def test_files_of_the_user_survive_and_stale_ones_go(out: Path) -> None:
    fill(out, OLD)
    out.chmod(0o2750)
    (out / "empty").mkdir()
    (out / "link").symlink_to("nowhere")
    number = (out / "mine.txt").stat().st_ino
    write_new(out)
    assert content(out) == AFTER
    assert (out / "empty").is_dir()
    assert os.readlink(out / "link") == "nowhere"
    assert (out / "mine.txt").stat().st_ino == number  # the same file, not a copy
    assert out.stat().st_mode & 0o7777 == 0o2750
    assert [path.name for path in out.parent.iterdir()] == ["out"]


def test_a_folder_with_files_is_refused(out: Path) -> None:
    fill(out, OLD)
    with pytest.raises(UsageError, match="not empty; use --force"), result_folder(str(out)):
        pass
    assert content(out.parent) == {f"out/{name}": text for name, text in OLD.items()}


def test_an_empty_folder_and_a_link_to_one_are_filled(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to("real")
    write_new(tmp_path / "link", replace=False)
    assert (tmp_path / "link").is_symlink()
    assert content(tmp_path / "real") == NEW


def test_the_working_folder_stays_the_same(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fill(out, OLD)
    monkeypatch.chdir(out)
    write_new(Path("."))
    assert content(Path(".")) == AFTER == content(out)


def test_a_folder_in_the_place_of_a_file_is_said(
    out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fill(out, {"report.json/mine": "my own"})
    with pytest.raises(UsageError, match=r"report\.json: found a folder where a file"):
        write_new(out)
    assert content(out.parent) == {"out/report.json/mine": "my own"}


def exchanged(monkeypatch: pytest.MonkeyPatch, out: Path) -> None:
    """As it comes."""


def renamed_twice(monkeypatch: pytest.MonkeyPatch, out: Path) -> None:
    """An operating system or file system that cannot exchange two folders."""
    monkeypatch.setattr(exchange, "exchange", lambda first, second: False)


def moved_one_by_one(monkeypatch: pytest.MonkeyPatch, out: Path) -> None:
    """A folder that must stay the same: the working directory."""
    monkeypatch.chdir(out)


EVENTS = {"os.rename", "os.link", "os.mkdir", "os.remove", "os.rmdir", "open", "ctypes.dlopen"}


def killed_at(step: int, work: Callable[[], None]) -> bool:
    """Do the work in a child that is killed before its n-th change; whether it was."""
    child = os.fork()
    if child == 0:
        left = step

        def count(event: str, arguments: object) -> None:
            nonlocal left
            if event in EVENTS:
                left -= 1
                if left < 0:
                    os.kill(os.getpid(), signal.SIGKILL)

        sys.addaudithook(count)
        try:
            work()
        finally:
            os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
@pytest.mark.parametrize("way", [exchanged, renamed_twice, moved_one_by_one])
def test_a_kill_at_any_moment_leaves_the_old_or_the_new(
    way: Callable[[pytest.MonkeyPatch, Path], None],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(os, "fsync", lambda file: None)  # a kill, not a power failure
    seen = []
    for step in range(1000):
        out = tmp_path / str(step) / "out"
        fill(out, OLD)
        way(monkeypatch, out)
        killed = killed_at(step, lambda out=out: write_new(out))
        if way is exchanged:
            assert content(out) in (OLD, AFTER)
        assert any(path.read_text() == "my own" for path in out.parent.rglob("mine.txt"))
        sweep(str(out))
        seen.append(content(out.parent))
        assert seen[-1] in ({f"out/{k}": v for k, v in files.items()} for files in (OLD, AFTER))
        write_new(out)  # whatever happened, the same command comes to its end
        assert content(out) == AFTER
        assert set(os.listdir(out.parent)) == {"out"}
        monkeypatch.chdir(tmp_path)
        if not killed:
            break
    assert seen[0] != seen[-1]
    assert step > 20


def test_the_second_writer_is_refused_and_names_the_first(out: Path) -> None:
    code = (
        "import sys; from mssegment.folders import result_folder\n"
        "with result_folder(sys.argv[1]) as folder: print('in', flush=True); input()"
    )
    first = subprocess.Popen(
        [sys.executable, "-c", code, str(out)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert first.stdout is not None
    assert first.stdout.readline() == "in\n"
    with pytest.raises(UsageError, match=rf"process {first.pid} \(-c .*\) is writing into it"):
        write_new(out)
    first.kill()
    first.wait()
    write_new(out)  # a dead process holds nothing, and what it left is gone
    assert content(out.parent) == {f"out/{name}": text for name, text in NEW.items()}


def test_two_threads_exclude_each_other(out: Path) -> None:
    with (
        result_folder(str(out)),
        pytest.raises(UsageError, match=rf"process {os.getpid()} "),
        result_folder(str(out), wait=0.1),
    ):
        pass


def test_a_key_keeps_what_was_written(out: Path) -> None:
    def interrupt(key: str | None) -> None:
        with pytest.raises(KeyboardInterrupt):
            write_new(out, error=KeyboardInterrupt, key=key)

    def is_resumed(key: str | None) -> bool:
        with suppress(KeyboardInterrupt), result_folder(str(out), key=key) as folder:
            assert content(folder.path) == (NEW if folder.resumed else {})
            raise KeyboardInterrupt
        return folder.resumed

    interrupt("a")
    assert is_resumed("a")
    assert is_resumed("a")
    assert not is_resumed("b")  # other settings
    interrupt("a")
    assert not is_resumed(None)
    assert not list(out.parent.iterdir())
    with pytest.raises(ZeroDivisionError):
        write_new(out, error=ZeroDivisionError, key="a")  # it would come again
    assert not is_resumed("a")
    interrupt("a")
    sweep(str(out), keep=True)
    assert write_new(out, key="a")
    assert content(out.parent) == {f"out/{name}": text for name, text in NEW.items()}


def test_errors_name_the_file_where_it_will_be(out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(file: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(UsageError) as caught:
        write_new(out)
    assert str(caught.value).startswith(f"{out}/report.json: cannot be written (No space left")
    assert "make room" in str(caught.value)
    assert not out.parent.exists()


def test_a_folder_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for name in ("file/out", "a" * 300):
        with (
            pytest.raises(UsageError, match="cannot be written"),
            result_folder(str(tmp_path / name)),
        ):
            pass
    with pytest.raises(UsageError, match="this is a file"), result_folder(str(tmp_path / "file")):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["file"]
