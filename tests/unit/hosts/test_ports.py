"""A host hears of its links from the kernel, without asking again and again."""

import subprocess
from pathlib import Path

# In a network namespace of its own: says whether there is a notice before and after a change.
SCENE = """
import select, subprocess
from hosts.hardware.ports import link_changes, take_notices
with link_changes() as changes:
    def received(limit_s):
        return bool(select.select([changes], [], [], limit_s)[0])
    before = received(0)
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    after = received(10)
    take_notices(changes)
    print(before, after, received(0))
"""
ROOT = Path(__file__).resolve().parents[3]


def test_a_link_that_changes_is_told_once() -> None:
    python = str(ROOT / ".venv" / "bin" / "python")
    apart = ["unshare", "--user", "--map-root-user", "--net"]
    done = subprocess.run(
        [*apart, python, "-c", SCENE], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert done.stdout.split() == ["False", "True", "False"]
