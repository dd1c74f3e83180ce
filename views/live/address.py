"""Where the page of a live view is: on the loopback, or behind a command that leads there.

docker/run leads to the page in a container from the machine's loopback; a command that starts
several networks leads to that of each from one address (command_page.py).
"""

import asyncio
import atexit
import os
import pwd
import secrets
import shutil
import signal
import socket
import subprocess
import sys
import webbrowser
from collections.abc import Coroutine
from contextlib import suppress
from dataclasses import dataclass
from errno import EADDRINUSE
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

from programs.connection_shares import SharedListener
from topologies.system.namespaces import machine_listener
from views.live.pages import NUMBER, Pages

LOOPBACK = "127.0.0.1"
ANNOUNCEMENT = "live view"
DESKTOP = ("PATH", "LANG", "DISPLAY", "WAYLAND_DISPLAY", "XAUTHORITY", "DBUS_SESSION_BUS_ADDRESS")

REDIRECT = """<!DOCTYPE html><html lang="en"><meta charset="utf-8"><title>qmn</title>
<meta name="referrer" content="no-referrer"><meta http-equiv="refresh" content="0; url=%s"></html>
"""


@dataclass(frozen=True)
class Place:
    """A port of the loopback, 0 for one that is free; with a socket, the port that leads to it."""

    port: int = 0
    socket: Path | None = None
    secret: str = ""  # of the address; none: one that is made
    number: int = 0  # of the network in its command, if that leads here

    def path(self) -> str:
        secret = self.secret or secrets.token_urlsafe(16)
        return f"{secret}/{self.number}" if self.number else secret


def place_given() -> Place | None:
    """Return where a command of several networks, or docker/run, wants it; None if neither."""
    setting, pages = os.environ.get, Pages.of_command()
    if pages is not None and (number := int(setting(NUMBER, "0"))):
        return Place(pages.port, Path(pages.socket(number)), pages.secret, number)
    path, port = setting("QMN_LIVE_SOCKET"), setting("QMN_LIVE_PORT")
    return Place(int(port), Path(path)) if path and port else None


def listen(place: Place) -> tuple[SharedListener, int]:
    """Return a socket that listens there, and the port of the page; OSError if it is taken."""
    if place.socket is None:
        try:
            listener = SharedListener(machine_listener(LOOPBACK, place.port))
        except OSError as error:
            if error.errno != EADDRINUSE:
                raise
            taken = f"port {place.port} of {LOOPBACK} is taken: choose another one by --port"
            raise OSError(taken) from error
        return listener, listener.getsockname()[1]
    place.socket.unlink(missing_ok=True)
    listener = SharedListener(socket.create_server(str(place.socket), family=socket.AF_UNIX))
    place.socket.chmod(0o600)
    return listener, place.port


async def until_a_signal(serving: Coroutine[Any, Any, None]) -> None:
    task = asyncio.ensure_future(serving)
    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, task.cancel)
    with suppress(asyncio.CancelledError):
        await task


def say(address: str, browser: bool, for_all: str = "") -> None:
    """Say where the page is, and where all can see it; open it if `browser`."""
    of_all = f"{ANNOUNCEMENT} for all: {for_all}\n" if for_all else ""
    print(f"{ANNOUNCEMENT}: {address}\n{of_all}", end="", flush=True)
    if browser and (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        try:
            open_browser(address)
        except OSError as error:
            print(f"qmn: no browser is opened: {error}", file=sys.stderr)


def open_browser(address: str) -> None:
    """Open the page in the browser of who called sudo; root itself has none. Raise OSError.

    All users see command lines: a browser gets the address by a file that its user alone can read.
    """
    if os.geteuid() != 0:
        webbrowser.open(redirect(address, pwd.getpwuid(os.getuid())).as_uri())
        return
    user, opener = os.environ.get("SUDO_USER", "root"), shutil.which("xdg-open")
    if user == "root" or opener is None:
        return
    file = redirect(address, pwd.getpwnam(user))
    variables = {"XDG_RUNTIME_DIR": f"/run/user/{os.environ['SUDO_UID']}"}  # sudo leaves it out
    subprocess.run(
        ["setsid", "--fork", "runuser", "-u", user, "--", opener, file.as_uri()],
        check=False,
        env={name: os.environ[name] for name in DESKTOP if name in os.environ} | variables,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )


def redirect(address: str, user: pwd.struct_passwd) -> Path:
    """Write a page that leads to an address, for a user alone; it goes with this process.

    It is in the home folder, as packed browsers (snap) can read neither /tmp nor hidden folders.
    """
    home = user.pw_dir if Path(user.pw_dir).is_dir() else None
    with NamedTemporaryFile(
        "w", dir=home, prefix="qmn-live-", suffix=".html", delete=False
    ) as file:
        path = Path(file.name)
        atexit.register(path.unlink, missing_ok=True)
        os.fchown(file.fileno(), user.pw_uid, user.pw_gid)
        file.write(REDIRECT % address)
    return path
