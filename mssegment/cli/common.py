"""What the commands share: options for settings, reading and writing documents, messages."""

from __future__ import annotations

import functools
import os
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

import click

from mssegment.cli.sentences import describe
from mssegment.configuration import KEYS, Setting, camera_settings, from_environment, from_options
from mssegment.documents import (
    STANDARD,
    AnyDocument,
    Document,
    HistoryEntry,
    read_document,
    write_bytes,
    write_document,
)
from mssegment.errors import UsageError
from mssegment.inputs.text import printable
from mssegment.records import Record

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

Command = TypeVar("Command", bound=Callable[..., Any])

FORMATS = ("text", "json", "csv", "markdown", "latex")
"""Formats of tables, repeated here so that ``--help`` need not import the tables."""

_FLAGS = {
    "background.remove": "--remove-background",
    "camera.file": "--camera",
    "report.labels": "--labels",
}
"""Flags that differ from the last part of the key."""

_SEVERAL = ("report.export", "report.labels", "input.images")
_CAMERA = "camera.file"


def flag_of(key: str) -> str:
    """The command-line flag of a setting: ``--bandwidth`` for ``cluster.bandwidth``."""
    return _FLAGS.get(key) or f"--{key.rpartition('.')[2].replace('_', '-')}"


def settings_options(*keys: str) -> Callable[[Command], Command]:
    """A decorator that adds an option for each key.

    The command gets the argument ``settings``, a list of Setting: those of the environment, then
    those of the options, which override them.
    """
    names = {key.replace(".", "__"): key for key in keys}

    def decorate(command: Command) -> Command:
        @functools.wraps(command)
        def wrapper(*args: Any, **kwargs: Any) -> Any:
            options = {key: kwargs.pop(name) for name, key in names.items()}
            kwargs["settings"] = [*from_environment(), *_from_options(options)]
            return command(*args, **kwargs)

        wrapped: Any = wrapper
        for name, key in reversed(names.items()):
            wrapped = _option(name, key)(wrapped)
        decorated: Command = wrapped
        return decorated

    return decorate


def _from_options(options: dict[str, Any]) -> list[Setting]:
    given = {key: value for key, value in options.items() if value not in (None, ())}
    camera = given.pop(_CAMERA, None)
    several = {key: list(given.pop(key)) for key in _SEVERAL if key in given}
    flags = {key: flag_of(key) for key in given | several}
    settings = from_options(given, flags) + from_options(several, flags)
    return settings + (camera_settings(camera) if camera is not None else [])


def _option(name: str, key: str) -> Callable[[Any], Any]:
    setting = KEYS[key]
    default = setting.default
    if isinstance(default, bool):
        default = "yes" if default else "no"
    shown = "" if default in (None, []) else f"  [default: {default}]"
    if key == _CAMERA:
        text = (
            "Calibrated camera: fx,fy,cx,cy in pixels, a file with these keys, or the file of a "
            "calibration program; FILE#NAME chooses one of several cameras."
        )
        return click.option(flag_of(key), name, metavar="CAMERA", help=text, shell_complete=files)
    if isinstance(setting.default, bool):
        flag = flag_of(key)
        return click.option(
            f"{flag}/--no-{flag[2:]}", name, default=None, help=f"{setting.description}{shown}"
        )
    repeatable = " Repeatable." if key in _SEVERAL else ""
    return click.option(
        flag_of(key),
        name,
        metavar=setting.choices.removesuffix("|none").removesuffix("..."),
        multiple=key in _SEVERAL,
        default=None,
        shell_complete=values_of(key),
        help=f"{setting.description}{repeatable}{shown}",
    )


def values_of(key: str) -> Callable[[click.Context, click.Parameter, str], list[CompletionItem]]:
    """What the option of a setting completes to: its words, or names of files."""

    def complete(
        context: click.Context, parameter: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        from click.shell_completion import CompletionItem

        words = _words_of(key)
        if not words and "TEXT" in KEYS[key].choices:
            return [CompletionItem(incomplete, type="file")]
        return [CompletionItem(word) for word in words if word.startswith(incomplete)]

    return complete


def complete_assignment(
    context: click.Context, parameter: click.Parameter, incomplete: str
) -> list[CompletionItem]:
    """What ``--set`` completes to: each key with each of its words, or with ``=``."""
    from click.shell_completion import CompletionItem

    found = [f"{key}={word}" for key in KEYS for word in (_words_of(key) or [""])]
    return [
        CompletionItem(text, help=KEYS[text.partition("=")[0]].description)
        for text in found
        if text.startswith(incomplete)
    ]


def files(
    context: click.Context, parameter: click.Parameter, incomplete: str
) -> list[CompletionItem]:
    """Completes to names of files."""
    from click.shell_completion import CompletionItem

    return [CompletionItem(incomplete, type="file")]


def _words_of(key: str) -> list[str]:
    return [word for word in KEYS[key].choices.split("|") if word.islower() and word != "none"]


class Console(Record, frozen=True):
    """The messages of a command on standard error, and the output of its document."""

    quiet: bool = False
    verbose: bool = False
    json: bool = False

    def stage(self, name: str, sentence: str, seconds: float) -> None:
        """Print one line for a completed stage: name, result and time."""
        if not self.quiet:
            print(f"{name:<12} {printable(sentence):<44} {seconds:6.2f} s", file=sys.stderr)

    def note(self, text: str) -> None:
        """Print a note below the line of a stage."""
        if not self.quiet:
            print(f"{'':<12} {printable(text)}", file=sys.stderr)

    @contextmanager
    def working(self, text: str) -> Iterator[Callable[[str], None]]:
        """Show a bar with what is done, count, rate and remaining time, on a terminal.

        Yields a function that changes the text beside it.
        """
        if self.quiet or not sys.stderr.isatty() or "NO_COLOR" in os.environ:
            yield lambda text: None
            return
        from mssegment.cli.progress_bar import stage_bar

        with stage_bar(text) as change:
            yield change

    @contextmanager
    def progress(self, text: str, total: int) -> Iterator[Callable[[str], None]]:
        """Show a progress bar with count and remaining time, on a terminal.

        Yields a function to call with the name of each item that is done.
        """
        if self.quiet or not sys.stderr.isatty() or "NO_COLOR" in os.environ:
            yield lambda name: None
            return
        from rich.console import Console as RichConsole
        from rich.progress import (
            BarColumn,
            MofNCompleteColumn,
            Progress,
            TextColumn,
            TimeElapsedColumn,
            TimeRemainingColumn,
        )

        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        )
        with Progress(*columns, console=RichConsole(stderr=True), transient=True) as bar:
            task = bar.add_task(text, total=total)
            yield lambda name: bar.update(task, advance=1, description=name)

    def deliver(
        self,
        document: Document,
        output: str | None,
        start: float,
        name: str | None = None,
    ) -> None:
        """Write a document and print the line of its stage.

        Parameters
        ----------
        document : Document
            The document.
        output : str or None
            The file to write, ``-`` for standard output. None writes to standard output too, but
            not to a terminal, unless ``--json`` is set.
        start : float
            ``time.perf_counter()`` at the start of the stage.
        name : str, optional
            The name of the stage, by default the command that writes such documents.
        """
        seconds, sentence = time.perf_counter() - start, describe(document)
        if output is not None or self.json or not sys.stdout.isatty():
            write_document(output or STANDARD, document)
        else:
            sentence += "; use -o FILE or a pipe to keep them"
        self.stage(name or document.made_by, sentence, seconds)
        self.details(document.history)

    def details(self, history: Sequence[HistoryEntry]) -> None:
        """Print the notes of the last stage of a document, and its settings if ``--verbose``."""
        if not history:
            return
        for note in history[-1].notes:
            self.note(note)
        if self.verbose:
            for key, value in history[-1].settings.items():
                self.note(f"{key} = {value}")


def console_options(command: Command) -> Command:
    """Add --json, --quiet, --verbose and --debug; the command gets the argument ``console``."""

    @functools.wraps(command)
    def wrapper(*args: Any, quiet: bool, verbose: bool, debug: bool, **kwargs: Any) -> Any:
        as_json = kwargs.pop("json")
        return command(*args, console=Console(quiet, verbose, as_json), **kwargs)

    wrapped: Any = wrapper
    for option in (
        click.option("--debug", is_flag=True, help="Show the traceback of an error."),
        click.option(
            "-v", "--verbose", is_flag=True, help="Also print the settings of each stage."
        ),
        click.option("-q", "--quiet", is_flag=True, help="Hide progress; errors still print."),
        click.option(
            "--json", is_flag=True, help="Write JSON to standard output, even on a terminal."
        ),
    ):
        wrapped = option(wrapped)
    decorated: Command = wrapped
    return decorated


def format_option(command: Command) -> Command:
    """Add ``--format`` for tables; the command gets the argument ``form``, None if not given."""
    return click.option(
        "--format",
        "form",
        type=click.Choice(FORMATS),
        help="Format of the tables.  [default: text on a terminal, otherwise json]",
    )(command)


def chosen_format(form: str | None, console: Console) -> str:
    """The format of the tables: as chosen, or text on a terminal and JSON otherwise."""
    return form or ("json" if console.json or not sys.stdout.isatty() else "text")


def put(text: str) -> None:
    """Write text to standard output, always as UTF-8; raises UsageError if that fails."""
    write_bytes(STANDARD, text.encode())


def output_option(command: Command) -> Command:
    """Add ``-o FILE``."""
    text = "Output file; - is standard output.  [default: -]"
    return click.option("-o", "--output", metavar="FILE", default=None, help=text)(command)


def document_argument(noun: str) -> Callable[[Command], Command]:
    """Add the argument for the input document; omitted or ``-`` is standard input."""
    return click.argument(
        "document",
        metavar=f"[{noun.upper()}]",
        required=False,
        default=STANDARD,
        shell_complete=files,
    )


def read_argument(path: str, kind: type[AnyDocument]) -> AnyDocument:
    """Read the input document of a command.

    Raises UsageError instead of waiting for keyboard input, DataError for an invalid document.
    """
    refuse_keyboard(path, f"{kind.kind} document", f"mssegment {kind.made_by} ...")
    return read_document(path, kind)


def refuse_keyboard(path: str, noun: str, producer: str) -> None:
    """Raises UsageError if ``path`` is standard input and standard input is a terminal."""
    if path == STANDARD and sys.stdin.isatty():
        raise UsageError(
            f"no {noun} given; name a file or pipe one in: "
            f"{producer} | {click.get_current_context().command_path} ..."
        )
