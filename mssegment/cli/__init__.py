"""The command line: one module per subcommand, imported only when that command runs.

``main`` is the only place where errors are converted to one line on stderr and an exit status.
"""

from __future__ import annotations

import contextlib
import gc
import importlib
import os
import sys
import warnings
from collections.abc import Sequence

import click

from mssegment.cli.signals import Signals, Stopped
from mssegment.errors import ExitStatus, MssegmentError
from mssegment.inputs import standard_error
from mssegment.inputs.text import printable
from mssegment.version import __version__

# The matrix products are small: two BLAS threads make them several times slower, and the last bits
# of the results would depend on the number of threads, so what the environment says does not count.
# Read when numpy is imported.
os.environ.update(
    dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
)

COMMANDS: dict[str, str] = {
    "run": "Run all stages and write the results to a folder.",
    "batch": "Run all stages on many pairs, clips or files of tracks.",
    "detect": "Detect Harris corners in images or a video.",
    "match": "Match corners between two views, or track them through a sequence.",
    "hypothesize": "Generate motion hypotheses from the tracks.",
    "cluster": "Find the modes of the hypotheses and select the motions.",
    "report": "Show the results and compare them with ground-truth labels.",
    "compare": "Compare several segmentations.",
    "import": "Import tracks from files of other programs and data sets.",
    "fuse": "Fuse repeated measurements of poses, many of them wrong.",
    "label": "Draw ground-truth labels in a local web page.",
    "benchmark": "Evaluate the segmentation on a public data set.",
    "init": "Write a commented configuration file.",
    "schema": "Write the JSON Schema of a document or of the configuration.",
    "completion": "Write a script that completes commands in a shell.",
}
"""Every command with its one-line help; its module is ``cli/<name>.py`` (``import_tracks.py``)."""

LONGEST_ERROR = 600
"""Characters of an error line; the middle of a longer one is cut, where a value was quoted."""
_MODULES = {"import": "import_tracks"}


def _instead_of(name: str) -> str:
    """What to type instead of a command that does not exist."""
    import difflib

    near = difflib.get_close_matches(name, COMMANDS, n=1)
    if near:
        return f"did you mean {near[0]}?"
    if os.path.lexists(name):
        return f"to segment a file or folder: `mssegment run {name}`"
    return f"the commands are {', '.join(COMMANDS)}"


class LazyGroup(click.Group):
    """A click group that imports the module of a command only when that command runs."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The names of the commands, in the usual order of use."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command; None if there is no such command."""
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"mssegment.cli.{_MODULES.get(cmd_name, cmd_name)}")
        command: click.Command = module.command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands from ``COMMANDS``, without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As in click, but suggest the nearest command for an unknown one."""
        name = args[0]
        if name not in COMMANDS and not name.startswith("-"):
            ctx.fail(f"No such command {name!r}; {_instead_of(name)}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> object:
        """As in click, but pass on a closed pipe, for which click would exit with status 1."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError:
            raise _ClosedPipe from None


class _ClosedPipe(Exception):
    """The reader of standard output has closed the pipe."""


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Example:  mssegment run 1.png 2.png --out out",
)
@click.version_option(__version__, prog_name="mssegment")
def cli() -> None:
    """Find the independently moving objects in an image pair or image sequence.

    The stages are detect, match, hypothesize, cluster and report. `run` executes all of them; they
    can also be run one by one, connected by pipes. Results go to standard output, progress and
    messages to standard error.
    """


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit with its status; by default with ``sys.argv``."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    standard_error.take()
    signals = Signals()
    status = 0
    try:
        signals.install()
        status = invoke(arguments, signals)
        signals.remove()
    except Stopped as stopped:  # between the command and here
        status = stopped.status
    gc.freeze()  # skips the garbage collection at exit
    sys.exit(status)


def invoke(arguments: list[str], signals: Signals | None = None) -> int:
    """Run one command line and return its exit status; an error prints one line on stderr.

    Parameters
    ----------
    arguments : list of str
        The arguments after the name of the program.
    signals : Signals, optional
        The handlers of signals, if they are installed.

    Returns
    -------
    int
        A value of ``ExitStatus``.
    """
    debug = "--debug" in arguments
    if not debug:
        # an error is a single line, without numpy's warnings before it
        warnings.simplefilter("ignore", RuntimeWarning)
    try:
        status = cli.main(args=arguments, prog_name="mssegment", standalone_mode=False)
        sys.stdout.flush()
    except (_ClosedPipe, BrokenPipeError):
        # the interpreter flushes stdout again at exit, which must not fail
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return ExitStatus.CLOSED_PIPE
    except (KeyboardInterrupt, click.Abort) as error:
        return _stopped(error)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()  # prints the help
        return ExitStatus.USAGE
    except click.ClickException as error:
        return _fail(_click_message(error), ExitStatus.USAGE)
    except MssegmentError as error:
        if debug:
            _print_traceback()
        return _fail(str(error), error.status)
    except Exception as error:
        if signals is not None and signals.stopped is not None:
            return _stopped(signals.stopped)  # an import that is interrupted may raise anything
        if debug:
            _print_traceback()
            return ExitStatus.UNFORESEEN
        text = f"unexpected {type(error).__name__}: {error}; this is a bug, use --debug for details"
        return _fail(text, ExitStatus.UNFORESEEN)
    return status if isinstance(status, int) else ExitStatus.DONE


def _stopped(error: BaseException) -> int:
    stopped = error.__cause__ if isinstance(error, click.Abort) else error
    if isinstance(stopped, Stopped):
        return _fail(stopped.word, stopped.status)
    return _fail("interrupted", ExitStatus.INTERRUPTED)


def _fail(message: str, status: int) -> int:
    line = printable(" ".join(message.split()), LONGEST_ERROR)
    with contextlib.suppress(OSError, ValueError, AttributeError):  # stderr may be closed
        print(f"mssegment: {line}", file=sys.stderr)
    return status


def _click_message(error: click.ClickException) -> str:
    message = error.format_message()
    if isinstance(error, click.NoSuchOption):
        message = f"{message.rstrip('.')}; {_instead_of_option(error)}"
    context = getattr(error, "ctx", None)
    return f"{message} (see `{context.command_path} --help`)" if context else message


def _instead_of_option(error: click.NoSuchOption) -> str:
    """What to write for an option that the command does not have."""
    command = (error.ctx.info_name or "") if error.ctx else ""
    if error.option_name in ("-o", "--output") and command in ("run", "batch"):
        return "the folder for the results is --out"
    if command in ("run", "batch"):
        from mssegment.cli.common import flag_of
        from mssegment.configuration import KEYS

        for key in KEYS:  # options of the single stages
            if error.option_name in flag_of(key).split("/"):
                return f"here it is --set {key}=VALUE"
    return "put file names that start with - after --"


def _print_traceback() -> None:
    import traceback

    traceback.print_exc()
