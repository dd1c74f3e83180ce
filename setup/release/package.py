"""qmn: the Mininet for programmable quantum networks.

Everything is in the folder `tree`, as in a checkout. Programs of a network have it on their path;
other programs on this Python see the name `qmn` alone.
"""

import os
import subprocess
import sys
from pathlib import Path

_TREE = Path(__file__).parent / "tree"
_MININET = Path("/usr/lib/python3/dist-packages/mininet")  # Debian's, without which no module loads
__path__ = [str(_TREE / "qmn")]
sys.path.append(str(_TREE))
os.environ["QMN_PYTHON"] = sys.executable


def main() -> None:
    """Become the command `qmn` of the tree, on this Python."""
    if not _MININET.exists():
        if sys.argv[1:] != ["doctor", "--install"]:
            command = Path(sys.executable).with_name("qmn")
            sys.exit(f"qmn: Mininet is not installed: run `sudo {command} doctor --install`")
        scripts = [_TREE / "setup" / "packages", _TREE / "apt-packages.txt"]
        if status := subprocess.run(scripts, check=False).returncode:
            sys.exit(status)
    os.execv(_TREE / "bin" / "qmn", ["qmn", *sys.argv[1:]])  # noqa: S606
