"""A live view beside networks that a command starts: programs of their own.

A command of one network has its page. One of several has an address (command_page.py) that goes
with them from page to page; networks find it by their environment, wherever they start.
"""

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path

from qmn.timeouts import LIVE_START_S
from topologies.system.processes.programs import NetworkError, Program, python
from topologies.system.runs.runtime import LIVE_PAGES
from views.live.acts import ACTS
from views.live.address import ANNOUNCEMENT
from views.live.hall import FOR_ALL
from views.live.pages import NUMBER, Pages

Say = Callable[[str], None]
SAY = partial(print, flush=True)
QMN_LIVE = [python(), "-m", "qmn", "live"]


@contextmanager
def live_view(
    opens: bool, folder: Path, say: Say = SAY, *, for_all: bool = False
) -> Iterator[None]:
    """Serve the page of the network that runs, and say where, as long as this lasts.

    If it is one of several of a command, its page is at the address of that, wanted here or not;
    else, if none is wanted, at that of all networks of this machine, if there is one.
    The log is in the folder of the run. Raise NetworkError if it does not begin in time.
    """
    (folder / ACTS).unlink(missing_ok=True)  # of an earlier network in this folder
    pages = Pages.of_command()
    with ExitStack() as stack:
        if pages is not None:
            stack.enter_context(_page_among(pages, folder.name, folder))
        elif opens or for_all:
            shown = ["--for-all"] if for_all else []
            say(announced_address(stack.enter_context(_server(folder, [*QMN_LIVE, *shown]))))
        elif all_of_machine := Pages.of_machine():
            names = os.environ.get("SUDO_USER"), folder.name  # whose it is, in a class
            with suppress(OSError, NetworkError):  # who shows all may have ended
                name = " ".join(filter(None, names))
                stack.enter_context(_page_among(all_of_machine, name, folder))
        yield


@contextmanager
def _page_among(pages: Pages, name: str, folder: Path) -> Iterator[None]:
    """Serve a page at the address of several networks."""
    with pages.one_more(name) as number:
        settings = f"{LIVE_PAGES}={pages.folder}", f"{NUMBER}={number}"
        with _server(folder, ["env", *settings, *QMN_LIVE, "--no-browser"]):
            yield


@contextmanager
def _server(folder: Path, command: list[str]) -> Iterator[Program]:
    server = Program("live", folder / "live.log")
    try:
        server.start(command)
        server.wait_for(ANNOUNCEMENT, LIVE_START_S)
        yield server
    finally:
        server.stop()


@contextmanager
def page_of_command(opens: bool, *, for_all: bool = False) -> Iterator[None]:
    """Serve an address that shows the networks that are started meanwhile, and say where it is."""
    if not (opens or for_all) or Pages.of_command():
        yield
        return
    server = begin_page_of_command(for_all=for_all)
    try:
        yield
    finally:
        server.stop()
        del os.environ[LIVE_PAGES]


def begin_page_of_command(say: Say = SAY, *, for_all: bool = False) -> Program:
    """Start what serves it, until this process ends; raise NetworkError if it does not begin."""
    folder = Path(tempfile.mkdtemp(prefix="qmn-live-"))
    server = Program("live", folder / "live.log")
    shown = [FOR_ALL] if for_all else []
    server.start([python(), "-m", "views.live.command_page", str(folder), *shown])
    try:
        server.wait_for(ANNOUNCEMENT, LIVE_START_S)
    except BaseException:
        server.stop()
        shutil.rmtree(folder, ignore_errors=True)
        raise
    say(announced_address(server))
    os.environ[LIVE_PAGES] = str(folder)
    return server


def announced_address(server: Program) -> str:
    """Return the lines that say where a page is; they come at once."""
    lines = server.output().splitlines()
    return "\n".join(line for line in lines if line.startswith(ANNOUNCEMENT))
