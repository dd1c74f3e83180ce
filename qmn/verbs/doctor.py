"""qmn doctor: check this machine for all that a network needs, and say how to mend the rest."""

import argparse
import json
import subprocess
from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from rich.console import Console

from qmn.running.machine import FAILS, LIMITED, UNCHECKED, WORKS, Finding, check_machine
from topologies.system.processes.programs import ROOT

STYLES = {WORKS: "green", LIMITED: "yellow", FAILS: "red", UNCHECKED: "dim"}
STATUS_OF_FAILURE = 1


def add_parser(verbs: Any) -> None:
    parser = verbs.add_parser("doctor", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print findings for programs")
    parser.add_argument(
        "--install", action="store_true", help="install missing Debian packages first (root)"
    )
    parser.set_defaults(call=call)


def call(arguments: argparse.Namespace) -> int:
    """Check and print; the status is 1 if a network cannot start as things are."""
    if arguments.install:
        scripts = [ROOT / "setup" / "packages", ROOT / "apt-packages.txt"]
        if (done := subprocess.run(scripts, check=False)).returncode:
            return done.returncode
    findings = list(check_machine())
    if arguments.json:
        print(json.dumps([asdict(finding) for finding in findings], indent=2))
    else:
        show(findings)
    return STATUS_OF_FAILURE if any(finding.state == FAILS for finding in findings) else 0


def show(findings: Iterable[Finding]) -> None:
    console = Console(highlight=False, markup=False)
    for finding in findings:
        console.print(f"{finding.state:<10}", style=STYLES[finding.state], end="")
        console.print(f"{finding.name}: {finding.found}", soft_wrap=True)
        if finding.remedy:
            console.print(f"{'':10}-> {finding.remedy}", soft_wrap=True)
