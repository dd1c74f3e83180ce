"""qmn wireshark [RUN]: packets and qubits of a run in Wireshark, or how to see them there."""

import argparse
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from qmn.results.run_folder import PRIVATE, give, give_tree
from qmn.results.timeline import TIMELINE, NoCaptures, merge
from views.archive.named_run import add_run
from views.dissection.dissectors import install, search_path
from wire.malformed import MalformedPacket

COLUMNS = {
    "No.": "%m",
    "Time": "%t",
    "Interface": "%Cus:frame.interface_name:0:R",
    "Source": "%s",
    "Destination": "%d",
    "Protocol": "%p",
    "Info": "%i",
}
# A packet that crosses a switch is captured on both links; c0 changes a set-up on its way.
COPY = "qmeta && (tcp.analysis.retransmission || tcp.analysis.out_of_order)"
ONCE = f'!({COPY} && !(qmeta.verdict != "PENDING"))'
FILTER = f"(qmeta || qevent) && {ONCE}"


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("wireshark", description=__doc__)
    add_run(parser, "latest", default="latest")
    parser.add_argument(
        "--whole", action="store_true", help="packets as captured, also of a long run"
    )
    parser.set_defaults(call=call)


def call(arguments: argparse.Namespace) -> int:
    try:
        timeline, dissectors = prepare(arguments.run, arguments.whole)
    except (NoCaptures, MalformedPacket, OSError) as error:
        print(f"qmn: {error}", file=sys.stderr)
        return 1
    command = wireshark_command(timeline, dissectors)
    missing = what_is_missing()
    if not missing:
        return subprocess.run(command, check=False).returncode
    print(f"{missing}. Where you have both, type:\n")
    print(f"    {shlex.join(command)}\n\nor here, in this terminal:\n")
    print(f"    {shlex.join(tshark_command(timeline, dissectors))}")
    return 0


def prepare(run: Path, whole: bool = False) -> tuple[Path, Path]:
    """Return a run's timeline, which is made if it is missing, and the installed dissectors.

    Whole: make the timeline again, as that of a long run has the heads of packets alone.
    """
    timeline = run.resolve() / TIMELINE
    if whole or not timeline.exists():
        give(merge(run.resolve()))
    return timeline, installed_dissectors()


def installed_dissectors() -> Path:
    """Write the dissectors into the user's cache; return the script.

    A script in a run's folder is never loaded: another person may have made that run.
    """
    folder = Path(os.environ.get("QMN_CACHE") or Path.home() / ".cache" / "qmn")
    folder.mkdir(mode=PRIVATE, parents=True, exist_ok=True)
    script = install(folder)
    give_tree(folder)
    return script


def what_is_missing() -> str:
    """Return why Wireshark cannot be started here, "" if it can."""
    if shutil.which("wireshark") is None:
        return "Wireshark is not installed here"
    if not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        return "There is no display here"
    return ""


def wireshark_command(timeline: Path, dissectors: Path) -> list[str]:
    columns = ",".join(f'"{name}","{form}"' for name, form in COLUMNS.items())
    options = [*_dissecting(dissectors), "-o", f"gui.column.format:{columns}"]
    return ["wireshark", *options, "-r", str(timeline), "-Y", ONCE]


def tshark_command(timeline: Path, dissectors: Path) -> list[str]:
    return ["tshark", *_dissecting(dissectors), "-r", str(timeline), FILTER]


def _dissecting(dissectors: Path) -> list[str]:
    return ["-X", f"lua_script:{dissectors}", *search_path(dissectors.parent)]
