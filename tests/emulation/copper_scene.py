"""Copper beside fibres: ports of veth on bridges, and a bridge that is plain Open vSwitch."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from agent_scene import BRIDGE, Controller, run

PLAIN = f"{BRIDGE}p"
PATIENCE_MS = 300_000


@contextmanager
def plain_open_vswitch() -> Iterator[Controller]:
    """A bridge without an agent, and its controller."""
    controller = Controller()
    try:
        bridge = f"add-br {PLAIN} -- set bridge {PLAIN} datapath_type=netdev protocols=OpenFlow14"
        run("ovs-vsctl", *f"{bridge} fail_mode=secure".split())
        run("ovs-vsctl", "set-controller", PLAIN, f"tcp:127.0.0.1:{controller.port}")
        controller.accept()
        controller.agree()
        have_patience(BRIDGE, PLAIN)
        yield controller
    finally:
        controller.socket.close()
        controller.listener.close()
        run("ovs-vsctl", "--if-exists", "del-br", PLAIN)


def have_patience(*bridges: str) -> None:
    """Let bridges not leave a controller that is silent, as a test is until it is its turn.

    Open vSwitch would after 10 s. It takes the setting for a connection that there is already.
    """
    asked = [f"-- get Bridge {bridge} controller" for bridge in bridges]
    rows = re.findall(r"[0-9a-f-]{36}", run("ovs-vsctl", *" ".join(asked).split()))
    reports = [f"-- set Controller {row} inactivity_probe={PATIENCE_MS}" for row in rows]
    run("ovs-vsctl", *" ".join(reports).split())


@contextmanager
def copper(ports: Sequence[int], *bridges: str) -> Iterator[None]:
    """Give each bridge copper ports of these numbers; `far_end` names where they lead."""
    made = []
    try:
        for bridge in bridges:
            for port in ports:
                near, far = near_end(bridge, port), far_end(bridge, port)
                run("ip", "link", "add", near, "type", "veth", "peer", "name", far)
                made.append(near)
                for end in (near, far):
                    run("ip", "link", "set", end, "up")
                request = ("--", "set", "interface", near, f"ofport_request={port}")
                run("ovs-vsctl", "add-port", bridge, near, *request)
        yield
    finally:
        for near in made:
            run("ip", "link", "del", near)


def near_end(bridge: str, port: int) -> str:
    """Return the interface that is a bridge's port."""
    return f"{bridge}c{port}"


def far_end(bridge: str, port: int) -> str:
    """Return the interface of this machine that a bridge's port leads to."""
    return f"{bridge}d{port}"
