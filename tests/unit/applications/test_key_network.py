"""Routes of keys over links that hosts have reported, against an enumeration of all of them."""

import random
from itertools import pairwise, permutations

import pytest

from applications.keys.key_network import KeyNetwork, NoRoute
from applications.keys.key_view import identifier, keys_view
from applications.keys.route_messages import KeyRouteRequest, LinkState
from controller_apps.policy.policy import Policy, Trusted
from controller_apps.policy.reading import parse_policy
from controller_apps.timeouts import SILENT_S

NODES = [f"10.0.0.{number}" for number in range(1, 8)]
NAMES = {node: f"h{number}" for number, node in enumerate(NODES, 1)}
Stock = dict[tuple[str, str], int]


def network(stock: Stock, policy: Policy | None = None) -> KeyNetwork:
    made = KeyNetwork(NAMES, policy or Policy(trusted=(Trusted("*"),)))
    for node in NODES:
        links = [LinkState(b, count, 0, 64, 0) for (a, b), count in stock.items() if a == node]
        made.take(node, tuple(links), 0.0)
    return made


def request(target: str, stored: int) -> KeyRouteRequest:
    return KeyRouteRequest(1, target, stored, "a", "b")


def enumerated(stock: Stock, wanted: int, trusted: set[str]) -> list[tuple[int, int]]:
    """Return (hops, keys of the poorest link) of every way from the first node to the last."""
    start, *between, end = NODES
    found = []
    for count in range(len(between) + 1):
        for middle in permutations(between, count):
            links = [stock.get(link, -1) for link in pairwise((start, *middle, end))]
            if min(links) >= wanted and {NAMES[node] for node in middle} <= trusted:
                found.append((len(links), min(links)))
    return found


def test_a_route_has_the_fewest_hops_and_then_the_most_keys() -> None:
    draw = random.Random(15)
    routed = 0
    for _ in range(150):
        stock = {
            (a, b): draw.randrange(9)
            for a in NODES
            for b in NODES
            if a != b and draw.random() < 0.3
        }
        trusted = {name for name in NAMES.values() if draw.random() < 0.8}
        policy = Policy(trusted=tuple(Trusted(name) for name in trusted))
        ways = enumerated(stock, 2, trusted)
        known = network(stock, policy)
        if not ways:
            with pytest.raises(NoRoute):
                known.route(NODES[0], request(NODES[-1], 2), 0.0)
            continue
        routed += 1
        nodes, least = known.route(NODES[0], request(NODES[-1], 2), 0.0)
        best = min(ways, key=lambda way: (way[0], -way[1]))
        assert (len(nodes) - 1, least) == best
        assert least == min(stock[link] for link in pairwise(nodes))
        assert {NAMES[node] for node in nodes[1:-1]} <= trusted
    assert 40 < routed < 140


def test_a_host_that_is_silent_or_unknown_relays_nothing() -> None:
    a, r, b, *_others = NODES
    known = network({(a, r): 5, (r, b): 5})
    assert known.route(a, request(b, 1), SILENT_S) == ((a, r, b), 5)
    with pytest.raises(NoRoute, match="no chain of key links that are in use joins h1 and h3"):
        known.route(a, request(b, 1), SILENT_S + 1)
    for target in ("10.9.9.9", a):
        with pytest.raises(NoRoute, match="is not another host with a key manager"):
            known.route(a, request(target, 1), 0.0)


def test_a_link_that_is_withheld_is_gone_round() -> None:
    a, r, b, s, *_others = NODES
    known = network({(a, r): 5, (a, s): 3, (s, b): 3})
    known.take(r, (LinkState(b, 5, 0, 64, 0, withheld=True),), 0.0)
    assert known.route(a, request(b, 1), 0.0) == ((a, s, b), 3)


def test_trust_can_be_in_keys_of_two_hosts_alone() -> None:
    a, r, b, c, *_others = NODES
    policy = parse_policy('[[trusted]]\nhost = "h2"\nbetween = ["h3", "h1"]')
    known = network({(a, r): 5, (r, b): 5, (r, c): 5}, policy)
    assert known.route(a, request(b, 1), 0.0)[0] == (a, r, b)
    with pytest.raises(NoRoute, match=r"h1 and h4: h2 could, if \[\[trusted\]\]"):
        known.route(a, request(c, 1), 0.0)


def test_the_view_names_prev_and_next_hop_of_a_route() -> None:
    a, r, b, *_others = NODES
    known = network({(a, r): 5, (r, b): 5})
    known.serve(a, request(b, 1), 0.0)
    hops = {}
    for node in keys_view(known, 0.0):
        for link in node["qkd_links"]["qkd_link"]:
            if link["qkdl_type"] == "VIRT":
                hops[node["qkdn_location_id"]] = link["virt_prev_hop"], link["virt_next_hop"]
    h1, h2, h3 = (identifier(name) for name in ("h1", "h2", "h3"))
    assert hops == {"h1": (None, [h2]), "h2": (h1, [h3]), "h3": (h2, [])}
