"""The jobs that are struck, and whether what they have delivered is right.

All that `qmn run` does over one quantum switch, with the programs that it starts beside the
network: key managers, tunnels, who sends and who receives. Not here: superdense coding over other
networks, and `load`, which are sdc's programs again; `--with strongswan` and `--eve`, which need
other packages and other hosts; and IP over light, which belongs to `qmn cli`: that has no session
that ends by itself.
"""

import json
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from random import Random


@dataclass(frozen=True)
class Job:
    """A run: its words on the command line, and what finds fault with what it leaves."""

    words: tuple[str, ...]
    faults: Callable[[Path, int], list[str]]  # of its folder, and its exit status
    session_s: float | None = None  # how long the session takes, if not about as long as sdc's


Make = Callable[[Random, Path], Job]


def command(words: tuple[str, ...], runs: Path) -> list[str]:
    """Return the command of a run."""
    return [sys.executable, "-m", "qmn", "run", *words, "--runs", str(runs)]


def sdc(random: Random, place: Path) -> Job:
    """Superdense coding of random bytes: what arrives is what was sent, or the beginning of it."""
    per_pair = random.random() < 0.3
    data = random.randbytes(random.randrange(20, 300) if per_pair else random.randrange(1 << 21))
    file = place / "sent"
    file.write_bytes(data)
    kind = ("--handshake", "per-pair") if per_pair else ()
    return Job(("sdc", "--file", str(file), *kind), partial(_received, data))


def _received(data: bytes, folder: Path, status: int) -> list[str]:
    received = folder / "received"
    got = received.read_bytes() if received.exists() else b""
    if status == 0 and got != data:
        return ["delivered, but other bytes than were sent"]
    return [] if data.startswith(got) else ["received bytes that nobody sent"]


def whole(place: Path) -> Job:
    """Return a job of the mean size of those that are struck, which nobody strikes."""
    return sdc(Random("whole"), place)


def service(name: str, count: int) -> Make:
    """Return a job that is right if its result says, without noise, what its status says."""

    def make(random: Random, _place: Path) -> Job:
        return Job((name, "--count", str(random.randrange(count // 10, count))), _untrue)

    return make


def with_keys(
    name: str, option: str, between: tuple[int, int], session_s: float | None = None
) -> Make:
    """Return a job of key distribution: hosts that keep a key of the same id keep the same one."""

    def make(random: Random, place: Path) -> Job:
        kept = place / "keys"

        def faults(folder: Path, status: int) -> list[str]:
            return _untrue(folder, status) + keys_differ(kept, status)

        words = (name, option, str(random.randrange(*between)), "--keys", str(kept))
        return Job(words, faults, session_s)

    return make


def keys_differ(folder: Path, status: int) -> list[str]:
    """Return which keys of hosts differ, by id: some host hands one out first, others second."""
    held: dict[str, set[bytes]] = {}
    hosts: dict[str, int] = Counter()
    for part in ("first", "second"):
        for path in folder.glob(f"*/*/{part}/*"):
            held.setdefault(path.name, set()).add(path.read_bytes())
            hosts[path.name] += 1
    if status == 0 and not any(number > 1 for number in hosts.values()):
        return ["delivered, but no key is kept by two hosts"]
    return [f"key {name} differs" for name, keys in held.items() if len(keys) > 1]


def vpn(random: Random, place: Path) -> Job:
    """A file through a tunnel: what arrives is what was sent, or the beginning of it."""
    program = random.choice(("wireguard", "tls"))
    data = random.randbytes(random.randrange(1 << 19, 1 << 21))  # one to four seconds of it
    file = place / "sent"
    file.write_bytes(data)
    words = ("vpn", "--with", program, "--file", str(file), "--seconds", "60")
    return Job(words, partial(_received, data), 3.0)


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


JOBS: tuple[Make, ...] = (
    sdc,
    sdc,
    service("teleport", 100_000),
    service("distribute", 20_000),
    service("swap", 10_000),
    service("ghz", 50_000),
    service("graph", 50_000),
    service("sense", 20_000),
    service("seal", 50_000),
    with_keys("qkd", "--count", (20_000, 200_000)),
    with_keys("conference", "--count", (10_000, 30_000)),
    with_keys("keys", "--seconds", (2, 5), session_s=4.0),
    vpn,
)
