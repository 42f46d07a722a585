"""The command line: one file per subcommand, loaded only when it is asked for.

``main`` is the only place where errors become one line on stderr and an exit status.
"""

from __future__ import annotations

import gc
import importlib
import os
import sys
import warnings
from collections.abc import Sequence

import click

from mssegment.errors import ExitStatus, MssegmentError
from mssegment.version import __version__

# the products are small: with two BLAS threads they run several times slower, and the last bits of
# the results would depend on their number; numpy reads this when it is imported
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

COMMANDS: dict[str, str] = {
    "run": "All stages: pictures or a configuration in, a folder of results out.",
    "detect": "Harris corners of pictures or a video.",
    "match": "Corners become tracks.",
    "hypothesize": "Tracks become motion hypotheses, points on a manifold.",
    "cluster": "Mean shift over the hypotheses: modes, motions, one label per track.",
    "report": "Tables, pictures, and the comparison with manual labels.",
    "compare": "Several segmentations side by side.",
    "import": "Tracks from a CSV or a published data set.",
    "label": "Manual labels: draw polygons over the frames in a local page.",
    "benchmark": "Run a published data set and compare with its labels.",
    "init": "A commented config.yaml to start from.",
}
"""Every command with its one-line help; its module is ``cli/<name>.py`` (``import_tracks.py``)."""

_MODULES = {"import": "import_tracks"}


class LazyGroup(click.Group):
    """A group that imports a command's module only when that command runs."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The names in the order in which they are used."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command, imported now."""
        if cmd_name not in COMMANDS:
            return None
        module = importlib.import_module(f"mssegment.cli.{_MODULES.get(cmd_name, cmd_name)}")
        command: click.Command = module.command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The list of commands, from ``COMMANDS``, so that help imports none of them."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """As click's, with the nearest name for a misspelt one."""
        name = args[0]
        if name not in COMMANDS and not name.startswith("-"):
            import difflib

            near = difflib.get_close_matches(name, COMMANDS, n=1)
            hint = f"did you mean {near[0]}?" if near else "`mssegment --help` lists them."
            ctx.fail(f"No such command {name!r}; {hint}")
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> object:
        """As click's, but a closed pipe is ours to handle (click would exit with status 1)."""
        try:
            return super().invoke(ctx)
        except BrokenPipeError:
            raise _ClosedPipe from None


class _ClosedPipe(Exception):
    """Whoever read our standard output has gone."""


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Two pictures in, a picture out:  mssegment run 1.png 2.png --model affine --out out",
)
@click.version_option(__version__, prog_name="mssegment")
def cli() -> None:
    """Find the independently moving things in an image pair or an image sequence.

    The stages are detect, match, hypothesize, cluster, report; `run` chains them, and so does a
    shell pipe. Data goes to standard output, everything else to standard error.
    """


def main(arguments: Sequence[str] | None = None) -> None:
    """The program: runs the command and exits with its status."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    status = invoke(arguments)
    gc.freeze()  # what is left is not searched for cycles before it all goes
    sys.exit(status)


def invoke(arguments: list[str]) -> int:
    """Runs one command line and returns its exit status; errors are one line on stderr."""
    debug = "--debug" in arguments
    if not debug:
        # an error is one line; numpy's warnings would stand between it and the user
        warnings.simplefilter("ignore", RuntimeWarning)
    try:
        status = cli.main(args=arguments, prog_name="mssegment", standalone_mode=False)
        sys.stdout.flush()
    except (_ClosedPipe, BrokenPipeError):
        # the interpreter flushes stdout once more at exit; let that go nowhere
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return ExitStatus.CLOSED_PIPE
    except (KeyboardInterrupt, click.Abort):
        return _fail("interrupted", ExitStatus.INTERRUPTED)
    except click.exceptions.NoArgsIsHelpError as error:
        error.show()  # the whole help, as click prints it
        return ExitStatus.USAGE
    except click.ClickException as error:
        return _fail(_click_message(error), ExitStatus.USAGE)
    except MssegmentError as error:
        if debug:
            _print_traceback()
        return _fail(str(error), error.status)
    except Exception as error:
        if debug:
            _print_traceback()
            return ExitStatus.UNFORESEEN
        text = f"unforeseen {type(error).__name__}: {error}; this is a bug, --debug shows where"
        return _fail(text, ExitStatus.UNFORESEEN)
    return status if isinstance(status, int) else ExitStatus.DONE


def _fail(message: str, status: ExitStatus) -> int:
    print(f"mssegment: {' '.join(message.split())}", file=sys.stderr)
    return status


def _click_message(error: click.ClickException) -> str:
    message = error.format_message()
    if isinstance(error, click.NoSuchOption):
        message = f"{message.rstrip('.')}; a file of that name goes after --"
    context = getattr(error, "ctx", None)
    return f"{message} (see `{context.command_path} --help`)" if context else message


def _print_traceback() -> None:
    import traceback

    traceback.print_exc()
