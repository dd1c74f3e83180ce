"""Addresses that the hosts' network needs beside those of the hosts."""

from collections.abc import Iterable
from ipaddress import IPv4Interface, IPv4Network


def broadcast(addresses: Iterable[str], prefix_length: int) -> str:
    return str(_network(addresses, prefix_length).broadcast_address)


def free_address(addresses: Iterable[str], prefix_length: int) -> str:
    taken = set(addresses)
    address = _network(taken, prefix_length).broadcast_address - 1
    while str(address) in taken:
        address -= 1
    return str(address)


def _network(addresses: Iterable[str], prefix_length: int) -> IPv4Network:
    return IPv4Interface(f"{next(iter(addresses))}/{prefix_length}").network
