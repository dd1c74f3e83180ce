"""The needs of a verb before it runs, and how they are met: root by the same command by sudo."""

import argparse
import enum
import os
import shutil
from collections.abc import Collection, Sequence
from contextlib import suppress
from pathlib import Path

from topologies.system import namespaces
from topologies.system.kernel.memory_share import groups_of_gone
from topologies.system.namespaces import RunningRun
from topologies.system.processes.programs import ROOT, NetworkError

# Of an installed package it is beside Python, which it names to the program.
PYTHON = os.environ.get("QMN_PYTHON")
COMMAND = str(Path(PYTHON).with_name("qmn") if PYTHON else ROOT / "bin" / "qmn")
OWN_FOLDER = Path("/run")  # is another one in a run
CHOOSE = "several networks run: {}; choose one, as in `qmn enter --run {} qmn devices`"


class NoRoot(Exception):
    """Root is needed, and there is no sudo to ask for it."""


def become_root(words: Sequence[str]) -> None:
    """Run `qmn` with these words by sudo in place of this program, unless it has root."""
    if os.geteuid() == 0:
        return
    sudo = shutil.which("sudo")
    if sudo is None:
        raise NoRoot("this needs root, and there is no sudo: run it as root, or by `qmn rootless`")
    os.execv(sudo, ["sudo", COMMAND, *words])  # noqa: S606


class Needs(enum.Enum):
    NOTHING = "nothing"
    ROOT = "root"
    NETWORK = "namespaces in which it starts networks"
    RUNNING = "the namespaces of the network that runs"


def needs_of(arguments: argparse.Namespace) -> Needs:
    """Return what this command needs, as its verb says: always, or by its arguments."""
    needed = getattr(arguments, "needs", Needs.NOTHING)
    result: Needs = needed(arguments) if callable(needed) else needed
    return result


def provide(arguments: argparse.Namespace, words: Sequence[str]) -> int | None:
    """Go on, perhaps in other processes, where a command has what it needs: return None there.

    Else return an exit status. Raise NoRoot or NetworkError.
    """
    needed = needs_of(arguments)
    if needed is Needs.NOTHING:
        return None
    become_root(words)
    if needed is Needs.NETWORK:
        _require_seen(vars(arguments).values())
        return _own_namespaces(arguments, words)
    if needed is Needs.RUNNING and (run := chosen()):
        namespaces.visit(run)
    return None


def _require_seen(values: Collection[object]) -> None:
    """Refuse what is in a folder that a run does not see: results there would be lost."""
    named = (each for each in values if isinstance(each, str) and os.path.exists(each))
    paths = (each for each in values if isinstance(each, Path))
    for path in (*map(Path, named), *paths):
        if path.is_absolute() and path.resolve().is_relative_to(OWN_FOLDER):
            raise NetworkError(f"{path}: a run has a {OWN_FOLDER} of its own: use another folder")


def chosen(keeper: int | None = None) -> RunningRun | None:
    """Return the run that is named by its keeper, or else the only one; None if there is none."""
    runs = namespaces.running()
    if keeper is not None:
        named = [run for run in runs if run.keeper == keeper]
        if not named:
            there = ", ".join(map(str, runs)) or "none"
            raise NetworkError(f"no network of process {keeper} runs; running: {there}")
        return named[0]
    if len(runs) > 1:
        raise NetworkError(CHOOSE.format(", ".join(map(str, runs)), runs[0].keeper))
    return runs[0] if runs else None


def _own_namespaces(arguments: argparse.Namespace, words: Sequence[str]) -> int | None:
    server = None
    for_all = getattr(arguments, "live_for_all", False)
    if getattr(arguments, "live", None) or for_all:
        # Served out here: the loopback of the run is another.
        from views.live.beside import begin_page_of_command

        server = begin_page_of_command(for_all=for_all)
    several = (getattr(arguments, "machines", None) or 1) > 1
    namespaces.running()  # removes the entries of runs that were killed
    for group in groups_of_gone():
        with suppress(FileNotFoundError):  # another run that starts has just removed it
            group.rmdir()
    status = namespaces.enter_new(["qmn", *words], own_network=not several)
    if status is not None and server is not None:
        server.stop()
    return status
