"""Options of key managers: which hosts keep keys with each other, how many, and for whom."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from applications.keys.config import KEY_LINK_PORTS, KeyLink
from applications.keys.key_managers import KeyService, start_key_managers
from hosts.middleware.session.options import MAX_COUNT
from qmn.network.programs import NetworkProgram, Start
from qmn.options import BadInput, check_range, check_ranges
from topologies.networks.network import Network
from wire.parameters.option import option

MOST_MARK = 16_384


@dataclass(frozen=True, kw_only=True)
class KeyServiceOptions:
    """The options of key managers; without a pair there are none."""

    GROUP: ClassVar[str] = "key managers"
    key_pair: tuple[str, ...] = option(
        (), "hosts that keep keys, who opens sessions first (repeatable)", metavar="A:B"
    )
    low_mark: int = option(
        32, "make more keys if fewer than this are left (32)", metavar="N", range=(1, MOST_MARK)
    )
    high_mark: int = option(
        128,
        "make keys until each direction has this many (128)",
        metavar="N",
        range=(1, MOST_MARK),
    )
    session_bits: int = option(
        40_000,
        "sifted bits of a session that fills stores (40000)",
        metavar="N",
        range=(1, MAX_COUNT),
    )
    key_protocol: str = option(
        "bb84", "by which stores are filled (bb84)", choices=tuple(KEY_LINK_PORTS)
    )
    sae: tuple[str, ...] = option(
        (),
        "another application that may ask for keys (repeatable; each host has sae-HOST)",
        metavar="ID=HOST",
        recorded=False,
    )
    keys_per_s: float = option(
        0.0,
        "keys of 256 bits that one application gets in the long run (0: no limit)",
        metavar="R",
        range=(0.0, 1e6),
    )
    withhold: bool = option(
        False, "give out no key while the last session had too many errors", recorded=False
    )
    certificates: Path | None = option(
        None,
        "ca.pem, NAME.pem and NAME.key of all (made for the run)",
        metavar="DIR",
        recorded=False,
    )


def key_service(options: KeyServiceOptions, hosts: Sequence[str]) -> KeyService | None:
    """Return what key managers are to do, None if there are none; BadInput for what cannot be."""
    check_ranges(options)
    check_range("high_mark", options.high_mark, options.low_mark, MOST_MARK)
    pairs = [pair_of(text, hosts) for text in options.key_pair]
    saes = dict(sae_of(text, hosts) for text in options.sae)
    if options.certificates is not None and not options.certificates.is_dir():
        raise BadInput(f"--certificates {options.certificates} is not a folder")
    if not pairs:
        return None
    link = KeyLink(
        peer="",
        opens=True,
        low=options.low_mark,
        high=options.high_mark,
        protocol=options.key_protocol,
        options={"count": options.session_bits},
    )
    return KeyService(pairs, link, saes, options.keys_per_s, options.withhold, options.certificates)


def pair_of(text: str, hosts: Sequence[str]) -> tuple[str, str]:
    """Return the two hosts of A:B."""
    one, colon, other = text.partition(":")
    if not colon or one == other or not {one, other} <= set(hosts):
        raise BadInput(f"--key-pair {text}: write A:B, two of {', '.join(hosts)}")
    return one, other


def sae_of(text: str, hosts: Sequence[str]) -> tuple[str, str]:
    name, equals, host = text.partition("=")
    if not equals or not name or host not in hosts:
        raise BadInput(f"--sae {text}: write ID=HOST, with one of {', '.join(hosts)}")
    return name, host


def prepare(options: KeyServiceOptions, hosts: Sequence[str]) -> Start | None:
    """Return what starts the key managers, None if there are none; raise BadInput."""
    service = key_service(options, hosts)
    if service is None:
        return None

    def start(network: Network) -> dict[str, str]:
        urls = start_key_managers(network, service).urls
        return {f"keys of {host}": url for host, url in urls.items()}

    return start


PROGRAM = NetworkProgram(KeyServiceOptions, prepare)
