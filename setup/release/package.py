"""qmn: the Mininet for programmable quantum networks.

Everything is in the folder `tree`, as in a checkout. Programs of a network have it on their path;
other programs on this Python see the name `qmn` alone.
"""

import os
import sys
from pathlib import Path

_TREE = Path(__file__).parent / "tree"
__path__ = [str(_TREE / "qmn")]
sys.path.append(str(_TREE))
os.environ["QMN_PYTHON"] = sys.executable


def main() -> None:
    """Become the command `qmn` of the tree, on this Python."""
    os.execv(_TREE / "bin" / "qmn", ["qmn", *sys.argv[1:]])  # noqa: S606
