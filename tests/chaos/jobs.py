"""The jobs that are struck, and whether what they have delivered is right."""

import json
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from random import Random


@dataclass(frozen=True)
class Job:
    """A run: its words on the command line, and what finds fault with what it leaves."""

    words: tuple[str, ...]
    faults: Callable[[Path, int], list[str]]  # of its folder, and its exit status


def command(words: tuple[str, ...], runs: Path) -> list[str]:
    """Return the command of a run."""
    return [sys.executable, "-m", "qmn", "run", *words, "--runs", str(runs)]


def sdc(random: Random, place: Path) -> Job:
    """Superdense coding of random bytes: what arrives is what was sent, or the beginning of it."""
    per_pair = random.random() < 0.3
    data = random.randbytes(random.randrange(20, 300) if per_pair else random.randrange(1 << 21))
    file = place / "sent"
    file.write_bytes(data)

    def faults(folder: Path, status: int) -> list[str]:
        received = folder / "received"
        got = received.read_bytes() if received.exists() else b""
        if status == 0 and got != data:
            return ["delivered, but other bytes than were sent"]
        return [] if data.startswith(got) else ["received bytes that nobody sent"]

    kind = ("--handshake", "per-pair") if per_pair else ()
    return Job(("sdc", "--file", str(file), *kind), faults)


def whole(place: Path) -> Job:
    """Return a job of the mean size of those that are struck, which nobody strikes."""
    return sdc(Random("whole"), place)


def service(name: str, count: int) -> Callable[[Random, Path], Job]:
    """Return a job that is right if its result says, without noise, what its status says."""

    def make(random: Random, _place: Path) -> Job:
        return Job((name, "--count", str(random.randrange(count // 10, count))), _untrue)

    return make


def qkd(random: Random, place: Path) -> Job:
    """Keys: both ends keep the same ones."""
    keys = place / "keys"

    def faults(folder: Path, status: int) -> list[str]:
        kept = [_keys(keys / one / other) for one, other in (("alice", "bob"), ("bob", "alice"))]
        if status == 0 and not kept[0]:
            return ["delivered, but no key is kept"]
        differing = [
            name for name in kept[0].keys() & kept[1].keys() if kept[0][name] != kept[1][name]
        ]
        return _untrue(folder, status) + [f"key {name} differs" for name in differing]

    words = ("qkd", "--count", str(random.randrange(20_000, 200_000)), "--keys", str(keys))
    return Job(words, faults)


def _keys(folder: Path) -> dict[str, bytes]:
    """Return the keys that a host keeps, by file."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}


def _untrue(folder: Path, status: int) -> list[str]:
    """Return what the exit status claims that the result does not.

    Not the other way round: what was delivered before a strike at clean-up ends with status 1.
    """
    result = folder / "result.json"
    if status:
        return []
    if not result.exists():
        return ["status 0, but no result"]
    delivered = json.loads(result.read_text()).get("delivered", False)
    return [] if delivered else ["status 0, but not delivered"]


JOBS: tuple[Callable[[Random, Path], Job], ...] = (
    sdc,
    sdc,
    service("teleport", 100_000),
    service("distribute", 20_000),
    service("swap", 10_000),
    qkd,
)
