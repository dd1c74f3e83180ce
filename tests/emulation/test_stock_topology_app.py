"""Ryu's own topology app, unchanged, over several quantum switches."""

from pathlib import Path

from conftest import wait_until
from fabric_scene import running
from test_stock_ryu_apps import APPS, Http

from topologies.ring import RingTopo
from topologies.system.runs.runtime import free_port


def test_the_topology_app_finds_fibers_between_switches(tmp_path: Path) -> None:
    address = f"127.0.0.1:{free_port()}"
    with running(RingTopo, tmp_path, rest=address, apps=APPS) as network:
        http, quantum = (
            Http(address, network.runtime.rest_token()),
            set(network.runtime.datapath_ids.values()),
        )
        ring = {
            tuple(int(network.net.get(end.node).dpid, 16) for end in (fiber.a, fiber.b))
            for fiber in network.runtime.fibers
            if fiber.a.node in network.runtime.switches
        }

        def found() -> set[tuple[int, int]]:
            links = http.get("/v1.0/topology/links")
            ends = {(int(link["src"]["dpid"], 16), int(link["dst"]["dpid"], 16)) for link in links}
            return {ends_ for ends_ in ends if quantum.issuperset(ends_)}

        both_ways = ring | {(there, here) for here, there in ring}
        wait_until(lambda: found() == both_ways, "every fibre of the ring is found both ways")
