"""A live view beside networks that a command starts: programs of their own.

A command of one network has its page. One of several has an address (command_page.py) that goes
with them from page to page; networks find it by their environment, wherever they start.
"""

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path

from qmn.timeouts import LIVE_START_S
from topologies.system.processes.programs import Program, python
from topologies.system.runs.runtime import LIVE_PAGES
from views.live.acts import ACTS
from views.live.address import ANNOUNCEMENT
from views.live.hall import FOR_ALL
from views.live.pages import NUMBER, Pages

Say = Callable[[str], None]
SAY = partial(print, flush=True)


@contextmanager
def live_view(
    wanted: bool, folder: Path, say: Say = SAY, *, for_all: bool = False
) -> Iterator[None]:
    """Serve the page of the network that runs, and say where, as long as this lasts.

    If it is one of several of a command, its page is at the address of that, wanted here or not;
    else, if none is wanted, at that of all networks of this machine, if there is one.
    The log is in the folder of the run. Raise NetworkError if it does not begin in time.
    """
    (folder / ACTS).unlink(missing_ok=True)  # of an earlier network in this folder
    alone = wanted or for_all
    pages = Pages.of_command() or (None if alone else Pages.of_machine())
    if pages is None and not alone:
        yield
        return
    server = Program("live", folder / "live.log")
    command = [python(), "-m", "qmn", "live", *(["--for-all"] if for_all and not pages else [])]
    with ExitStack() as stack:
        if pages is not None:
            names = os.environ.get("SUDO_USER"), folder.name  # whose it is, in a class
            number = stack.enter_context(pages.one_more(" ".join(filter(None, names))))
            found = f"{LIVE_PAGES}={pages.folder}", f"{NUMBER}={number}"
            command = ["env", *found, *command, "--no-browser"]
        stack.callback(server.stop)
        server.start(command)
        server.wait_for(ANNOUNCEMENT, LIVE_START_S)
        if pages is None:
            say(announced_address(server))
        yield


@contextmanager
def page_of_command(wanted: bool, say: Say = SAY, *, for_all: bool = False) -> Iterator[None]:
    """Serve an address that shows the networks that are started meanwhile, and say where it is."""
    if not (wanted or for_all) or Pages.of_command():
        yield
        return
    server = begin_page_of_command(say, for_all=for_all)
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
