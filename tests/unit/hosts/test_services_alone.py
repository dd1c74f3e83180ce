"""The services of packages, each imported first: nobody knows in which order users do."""

import subprocess
import sys

from topologies.system.processes.programs import ROOT
from wire.light import registered_services

EACH = """
import os, sys, traceback
from importlib import import_module
import hosts.middleware.session.ends  # which all of them need

failed = []
for name in sys.argv[1:]:
    child = os.fork()
    if child == 0:
        try:
            import_module(name)
        except Exception:
            traceback.print_exc()
            os._exit(1)
        os._exit(0)
    if os.waitpid(child, 0)[1]:
        failed.append(name)
sys.exit(", ".join(failed) or 0)
"""


def test_the_ends_of_each_service_can_be_imported_before_all_others() -> None:
    names = sorted({service.ends.partition(":")[0] for service in registered_services()})
    assert "applications.key_distribution.session" in names
    done = subprocess.run(
        [sys.executable, "-c", EACH, *names],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
