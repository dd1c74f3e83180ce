"""A user who is not root starts a network by `qmn rootless`, and nobody else reaches it."""

import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from conftest import ROOT, wait_until
from limits import SOON_S

pytestmark = pytest.mark.skipif(
    not ROOT.stat().st_mode & 0o001, reason="other users cannot enter this checkout"
)
USER, OTHER = 64_001, 64_002  # which have no accounts
CHECKOUT = "/mnt"  # whose parents everybody can enter
AS_USER = """
mount --bind "$1/subids" /etc/subuid && mount --bind "$1/subids" /etc/subgid
mount --bind "$1/passwd" /etc/passwd && mount --bind "$2" /mnt && cd "$1/$3"
exec setpriv --reuid="$3" --regid="$3" --clear-groups env HOME="$1/$3" "${@:4}"
"""


@pytest.fixture
def home() -> Iterator[Path]:
    """A folder with one for each user, and their entries for /etc."""
    with TemporaryDirectory() as name:
        folder = Path(name)
        folder.chmod(0o755)
        for user in (USER, OTHER):
            (folder / str(user)).mkdir()
            os.chown(folder / str(user), user, user)
        names = {USER: "one", OTHER: "other"}
        own = "".join(f"{name}:x:{uid}:{uid}::/:/bin/sh\n" for uid, name in names.items())
        (folder / "passwd").write_text(Path("/etc/passwd").read_text() + own)
        ids = (f"{name}:{uid * 65_536}:65536\n" for uid, name in names.items())
        (folder / "subids").write_text("".join(ids))
        yield folder


def as_user(home: Path, user: int, *command: str) -> list[str]:
    script = ("bash", "-c", AS_USER, "bash", str(home), str(ROOT), str(user))
    return ["unshare", "--mount", *script, *command]


def qmn(home: Path, user: int, *words: str) -> "subprocess.CompletedProcess[str]":
    command = as_user(home, user, f"{CHECKOUT}/bin/qmn", "rootless", *words)
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=SOON_S)


def does(command: list[str]) -> bool:
    return subprocess.run(command, capture_output=True, check=False).returncode == 0


def test_a_network_without_root_is_its_users_alone(home: Path) -> None:
    reader, writer = os.pipe()
    command = as_user(home, USER, f"{CHECKOUT}/bin/qmn", "rootless", "cli", "sdc")
    with subprocess.Popen(command, stdin=reader, stdout=subprocess.DEVNULL) as process:
        os.close(reader)
        try:
            wait_until(lambda: "q1" in qmn(home, USER, "devices").stdout, "the network")
            assert Path(f"/proc/{process.pid}").stat().st_uid == USER
            inside = qmn(home, USER, "enter", "sh", "-c", "id -u; ovs-vsctl list-br")
            assert inside.stdout.split() == ["0", "q1", "s1"]
            assert "no network runs" in qmn(home, OTHER, "devices").stderr
            for words in (
                ("nsenter", "--target", str(process.pid), "--user", "--preserve-credentials", "ls"),
                ("ls", f"/proc/{process.pid}/root/"),
                ("kill", "-0", str(process.pid)),
            ):
                tried = [does(as_user(home, user, *words)) for user in (USER, OTHER)]
                assert tried == [True, False], words
        finally:
            os.close(writer)
        assert process.wait(SOON_S) == 0
    assert (home / str(USER) / "runs" / "latest" / "result.json").stat().st_uid == USER


def test_root_needs_no_namespace_of_a_user() -> None:
    command = [str(ROOT / "bin" / "qmn"), "rootless", "devices"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "qmn: you are root: leave out `rootless`\n")
