"""``python -m mssegment``, the same as ``mssegment``."""

from mssegment.cli import main

if __name__ == "__main__":
    main()
