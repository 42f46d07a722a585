"""What the commands share: options made from settings, documents in and out, words to stderr."""

from __future__ import annotations

import functools
import os
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

import click

from mssegment.cli.sentences import describe
from mssegment.configuration import KEYS, Setting, camera_settings, from_environment, from_options
from mssegment.documents import (
    STANDARD,
    AnyDocument,
    Document,
    read_document,
    write_bytes,
    write_document,
)
from mssegment.errors import UsageError
from mssegment.records import Record

Command = TypeVar("Command", bound=Callable[..., Any])

FORMATS = ("text", "json", "csv", "markdown", "latex")
"""Formats of tables, here so that ``--help`` need not load the tables themselves."""

_FLAGS = {
    "background.remove": "--remove-background",
    "camera.file": "--camera",
    "report.labels": "--labels",
}
"""Flags that are not simply the last word of the key."""

_SEVERAL = ("report.labels",)
_CAMERA = "camera.file"


def flag_of(key: str) -> str:
    """The command-line flag of a setting: ``--bandwidth`` for ``cluster.bandwidth``."""
    return _FLAGS.get(key) or f"--{key.rpartition('.')[2].replace('_', '-')}"


def settings_options(*keys: str) -> Callable[[Command], Command]:
    """Adds an option for each key; the command gets ``settings``: environment, then options."""
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
    default = "yes" if setting.default is True else setting.default
    shown = "" if default in (None, []) else f"  [default: {default}]"
    if key == _CAMERA:
        text = "The calibrated camera in pixels: fx,fy,cx,cy or a YAML/JSON file with these keys."
        return click.option(flag_of(key), name, metavar="CAMERA", help=text)
    if isinstance(setting.default, bool):
        flag = flag_of(key)
        return click.option(
            f"{flag}/--no-{flag[2:]}", name, default=None, help=f"{setting.description}{shown}"
        )
    return click.option(
        flag_of(key),
        name,
        metavar=setting.choices.removesuffix("|none").removesuffix("..."),
        multiple=key in _SEVERAL,
        default=None,
        help=f"{setting.description}{shown}",
    )


class Console(Record, frozen=True):
    """What a command says on standard error, and how it hands over its document."""

    quiet: bool = False
    verbose: bool = False
    json: bool = False

    def stage(self, name: str, sentence: str, seconds: float) -> None:
        """One line for a stage that is done."""
        if not self.quiet:
            print(f"{name:<12} {sentence:<44} {seconds:6.2f} s", file=sys.stderr)

    def note(self, text: str) -> None:
        """A sentence for the user."""
        if not self.quiet:
            print(f"{'':<12} {text}", file=sys.stderr)

    @contextmanager
    def working(self, text: str) -> Iterator[Callable[[str], None]]:
        """A spinner with elapsed time on a terminal; yields a function that changes its text."""
        if self.quiet or not sys.stderr.isatty() or "NO_COLOR" in os.environ:
            yield lambda text: None
            return
        from rich.console import Console
        from rich.progress import Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

        columns = (SpinnerColumn(), TextColumn("{task.description}"), TimeElapsedColumn())
        with Progress(*columns, console=Console(stderr=True), transient=True) as progress:
            task = progress.add_task(text, total=None)
            yield lambda text: progress.update(task, description=text)

    @contextmanager
    def progress(self, text: str, total: int) -> Iterator[Callable[[str], None]]:
        """A bar with count, rate and time left on a terminal; call the function per item."""
        if self.quiet or not sys.stderr.isatty() or "NO_COLOR" in os.environ:
            yield lambda name: None
            return
        from rich.console import Console
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
        with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
            task = bar.add_task(text, total=total)
            yield lambda name: bar.update(task, advance=1, description=name)

    def deliver(
        self,
        document: Document,
        output: str | None,
        start: float,
        name: str | None = None,
    ) -> None:
        """Writes the document to ``output`` or standard output; ``name`` is the stage's.

        A terminal is no place for a document: there the sentence on stderr is all, unless
        ``--json`` or ``-o -`` asks for it.
        """
        seconds, sentence = time.perf_counter() - start, describe(document)
        if output is not None or self.json or not sys.stdout.isatty():
            write_document(output or STANDARD, document)
        else:
            sentence += "; -o FILE keeps them, a pipe passes them on"
        self.stage(name or document.made_by, sentence, seconds)
        self.details(document)

    def details(self, document: Document) -> None:
        """What the stage that wrote the document has to say; ``--verbose``: with its settings."""
        if not document.history:
            return
        for note in document.history[-1].notes:
            self.note(note)
        if self.verbose:
            for key, value in document.history[-1].settings.items():
                self.note(f"{key} = {value}")


def console_options(command: Command) -> Command:
    """Adds --json, --quiet, --verbose, --debug; the command gets ``console``."""

    @functools.wraps(command)
    def wrapper(*args: Any, quiet: bool, verbose: bool, debug: bool, **kwargs: Any) -> Any:
        as_json = kwargs.pop("json")
        return command(*args, console=Console(quiet, verbose, as_json), **kwargs)

    wrapped: Any = wrapper
    for option in (
        click.option("--debug", is_flag=True, help="Show the traceback of an error."),
        click.option("-v", "--verbose", is_flag=True, help="Also say the settings of every stage."),
        click.option("-q", "--quiet", is_flag=True, help="Say nothing on standard error."),
        click.option("--json", is_flag=True, help="JSON on standard output, also to a terminal."),
    ):
        wrapped = option(wrapped)
    decorated: Command = wrapped
    return decorated


def format_option(command: Command) -> Command:
    """Adds ``--format`` for tables; the command gets ``form``, None where nobody chose."""
    return click.option(
        "--format",
        "form",
        type=click.Choice(FORMATS),
        help="Format of the tables.  [default: text on a terminal, json in a pipe]",
    )(command)


def chosen_format(form: str | None, console: Console) -> str:
    """A person gets text, a program JSON, unless one is asked for."""
    return form or ("json" if console.json or not sys.stdout.isatty() else "text")


def put(text: str) -> None:
    """Text to standard output, UTF-8 whatever the terminal's locale; raises UsageError."""
    write_bytes(STANDARD, text.encode())


def output_option(command: Command) -> Command:
    """Adds ``-o FILE``."""
    text = "File to write; - is standard output.  [default: -]"
    return click.option("-o", "--output", metavar="FILE", default=None, help=text)(command)


def document_argument(noun: str) -> Callable[[Command], Command]:
    """Adds the argument for the document before this stage; none or ``-`` is standard input."""
    return click.argument("document", metavar=f"[{noun.upper()}]", required=False, default=STANDARD)


def read_argument(path: str, kind: type[AnyDocument]) -> AnyDocument:
    """The document that the argument names; raises UsageError rather than wait for a keyboard."""
    refuse_keyboard(path, f"{kind.kind} document", f"mssegment {kind.made_by} ...")
    return read_document(path, kind)


def refuse_keyboard(path: str, noun: str, producer: str) -> None:
    """Raises UsageError where ``path`` is standard input and that is a keyboard."""
    if path == STANDARD and sys.stdin.isatty():
        raise UsageError(
            f"no {noun} given; name a file, or pipe one in: "
            f"{producer} | {click.get_current_context().command_path} ..."
        )
