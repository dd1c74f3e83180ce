"""The command line: one file per verb."""

import os
import sys
from pathlib import Path


def main() -> None:
    """Become bin/qmn, as the script of an installed package does, where the tree hides that."""
    os.execv(Path(__file__).parents[1] / "bin" / "qmn", ["qmn", *sys.argv[1:]])  # noqa: S606
