"""Root for the verbs that need it: the same command again by sudo."""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path

from topologies.system.processes.programs import ROOT

# Of an installed package it is beside Python, which it names to the program.
PYTHON = os.environ.get("QMN_PYTHON")
COMMAND = str(Path(PYTHON).with_name("qmn") if PYTHON else ROOT / "bin" / "qmn")


class NoRoot(Exception):
    """Root is needed, and there is no sudo to ask for it."""


def become_root(words: Sequence[str]) -> None:
    """Run `qmn` with these words by sudo in place of this program, unless it has root."""
    if os.geteuid() == 0:
        return
    sudo = shutil.which("sudo")
    if sudo is None:
        raise NoRoot("this needs root, and there is no sudo: run it as root")
    os.execv(sudo, ["sudo", COMMAND, *words])  # noqa: S606
