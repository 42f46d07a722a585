"""The command ``mssegment``, also as ``python -m mssegment``.

While the program starts, before it has opened anything, Ctrl-C ends it at once: an interrupt in the
middle of an import would be a traceback.
"""

from __future__ import annotations

import os
import signal


def main() -> None:
    """Run the command line and exit with its status."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _leave)
    from mssegment.cli import main

    main()


def _leave(number: int, frame: object) -> None:
    os.write(2, b"mssegment: interrupted\n")
    os._exit(130)


if __name__ == "__main__":
    main()
