"""Options of key managers: which hosts keep keys with each other, how many, and for whom."""

import argparse
from pathlib import Path

from hosts.middleware.services.key_distribution.options import MAX_COUNT
from qmn.network.options import BadInput, check_range
from topologies.key_managers import KeyService
from wire.key_manager import KeyLink

PROTOCOLS = ("bb84", "bbm92")
LOW, HIGH, SESSION_BITS = 32, 128, 40_000
MOST_MARK = 16_384


def add_key_service_options(parser: argparse.ArgumentParser, *, always: bool) -> None:
    """Describe the options; `always`: there are key managers even if no pair is named."""
    default = "alice:bob" if always else "without, no key managers"
    text = f"hosts that keep keys, who opens sessions first (repeatable; {default})"
    add = parser.add_argument
    pairs = ["alice:bob"] if always else []
    add("--key-pair", action="append", default=[], metavar="A:B", help=text)
    parser.set_defaults(key_pairs=pairs)
    add("--low-mark", type=int, default=LOW, metavar="N", help=f"keys: with fewer, more ({LOW})")
    text = f"keys of either direction, until there are so many ({HIGH})"
    add("--high-mark", type=int, default=HIGH, metavar="N", help=text)
    text = f"sifted bits of a session that fills stores ({SESSION_BITS})"
    add("--session-bits", type=int, default=SESSION_BITS, metavar="N", help=text)
    text = f"by which photons stores are filled ({PROTOCOLS[0]})"
    add("--key-protocol", choices=PROTOCOLS, default=PROTOCOLS[0], help=text)
    text = "another application that may ask for keys (repeatable; each host has sae-HOST)"
    add("--sae", action="append", default=[], metavar="ID=HOST", help=text)
    text = "keys that one application gets in the long run, of 256 bits (no limit)"
    add("--keys-per-s", type=float, default=0.0, metavar="R", help=text)
    text = "give out no key while the last session had too many errors"
    add("--withhold", action="store_true", help=text)
    text = "ca.pem, NAME.pem and NAME.key of all (made for the run)"
    add("--certificates", type=Path, metavar="DIR", help=text)


def key_service(arguments: argparse.Namespace, hosts: list[str]) -> KeyService | None:
    """Return what key managers are to do, None if there are none; BadInput for what cannot be."""
    pairs = [pair_of(text, hosts) for text in arguments.key_pair or arguments.key_pairs]
    saes = dict(sae_of(text, hosts) for text in arguments.sae)
    if not pairs:
        return None
    check_range(arguments, "low_mark", 1, MOST_MARK)
    check_range(arguments, "high_mark", arguments.low_mark, MOST_MARK)
    check_range(arguments, "session_bits", 1, MAX_COUNT)
    check_range(arguments, "keys_per_s", 0, 1e6)
    link = KeyLink(
        peer="",
        opens=True,
        low=arguments.low_mark,
        high=arguments.high_mark,
        protocol=arguments.key_protocol,
        options={"count": arguments.session_bits},
    )
    return KeyService(
        pairs, link, saes, arguments.keys_per_s, arguments.withhold, arguments.certificates
    )


def pair_of(text: str, hosts: list[str]) -> tuple[str, str]:
    """Return the two hosts of A:B."""
    one, colon, other = text.partition(":")
    if not colon or one == other or not {one, other} <= set(hosts):
        raise BadInput(f"--key-pair {text}: write A:B, two of {', '.join(hosts)}")
    return one, other


def sae_of(text: str, hosts: list[str]) -> tuple[str, str]:
    """Return SAE ID and host of ID=HOST."""
    name, equals, host = text.partition("=")
    if not equals or not name or host not in hosts:
        raise BadInput(f"--sae {text}: write ID=HOST, with one of {', '.join(hosts)}")
    return name, host
