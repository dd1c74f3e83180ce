"""The fingerprint of our programs: machines that share a network must have the same."""

import hashlib
import sys

from topologies.system.processes.programs import ROOT

FOLDERS = ("wire", "programs", "hosts", "topologies")


def fingerprint() -> str:
    """Return that of the source of all that runs on hosts, and of Python's version."""
    digest = hashlib.sha256(repr(sys.version_info[:2]).encode())
    for folder in FOLDERS:
        for file in sorted((ROOT / folder).rglob("*.py")):
            digest.update(str(file.relative_to(ROOT)).encode() + b"\0" + file.read_bytes())
    return digest.hexdigest()
