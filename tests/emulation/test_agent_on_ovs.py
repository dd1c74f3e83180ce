"""The agent as a program, between a real Open vSwitch bridge and a controller of the test's own.

The dispatcher is a gRPC server that knows CrossConnect alone, so that it can be slow or fail.
"""

import os
import queue
import select
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import grpc
import pytest
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser
from os_ken.ofproto.ofproto_parser import msg as parse
from os_ken.ofproto.ofproto_protocol import ProtocolDesc

from qswitch_agent.openflow import HEADER, Framer
from wire.config import AgentConfig
from wire.dispatcher_pb2 import CrossConnectReply, CrossConnectRequest
from wire.service import TOKEN_KEY

DEADLINE_S = 10.0
FIBER_PORTS = [1, 2, 3, 4]
DATAPATH = ProtocolDesc(version=ofp.OFP_VERSION)
BRIDGE = f"qat{os.getpid()}"
ROOT = Path(__file__).parents[2]
TOKEN = "0f1e2d"

pytestmark = pytest.mark.skipif(
    os.geteuid() != 0 or shutil.which("ovs-vsctl") is None,
    reason="needs root and Open vSwitch",
)


def wait_until(condition: Callable[[], object], what: str) -> None:
    """Return when the condition holds; fail after the deadline."""
    end = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end, f"waited {DEADLINE_S} s for {what}"
        time.sleep(0.002)


def run(*command: str) -> str:
    """Run a command and return what it printed."""
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def flows(*arguments: str) -> str:
    """Run ovs-ofctl on the bridge."""
    verb, *rest = arguments
    return run("ovs-ofctl", "-O", "OpenFlow14", verb, BRIDGE, *rest)


class Dispatcher:
    """Records each set of cross-connects when it answers; passes may be withheld."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.asked = 0
        self.sets: list[list[tuple[int, int]]] = []
        self.tokens: set[Any] = set()
        self.failure: grpc.StatusCode | None = None
        self.open = threading.Event()
        self.open.set()
        handler = grpc.method_handlers_generic_handler(
            "qmn.Dispatcher",
            {
                "CrossConnect": grpc.unary_unary_rpc_method_handler(
                    self._cross_connect,
                    request_deserializer=CrossConnectRequest.FromString,
                    response_serializer=CrossConnectReply.SerializeToString,
                )
            },
        )
        self.server = grpc.server(ThreadPoolExecutor(2))
        self.server.add_generic_rpc_handlers((handler,))
        self.server.add_insecure_port(f"unix:{path}")
        self.server.start()

    def _cross_connect(self, request: Any, context: Any) -> CrossConnectReply:
        self.asked += 1
        self.tokens.add(dict(context.invocation_metadata())[TOKEN_KEY])
        assert self.open.wait(DEADLINE_S)
        if self.failure is not None:
            context.abort(self.failure, "the mirror is stuck")
        self.sets.append(sorted((one.in_port, one.out_port) for one in request.connections))
        return CrossConnectReply(ready_ns=time.time_ns())


class Controller:
    """A controller that says what the test says."""

    def __init__(self) -> None:
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.listener.settimeout(DEADLINE_S)
        self.port = self.listener.getsockname()[1]
        self.socket = socket.socket()

    def accept(self) -> None:
        """Take the next connection in place of the one there was, and exchange HELLOs."""
        self.socket.close()
        self.socket = self.listener.accept()[0]
        self.socket.settimeout(DEADLINE_S)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.framer, self.received = Framer(), list[bytes]()
        self.send(parser.OFPHello(DATAPATH), 1)
        assert isinstance(self.next(), parser.OFPHello)

    def send(self, message: Any, xid: int) -> None:
        message.set_xid(xid)
        message.serialize()
        self.socket.sendall(bytes(message.buf))

    def next(self) -> Any:
        """Return the next message, decoded by os_ken."""
        while not self.received:
            data = self.socket.recv(65536)
            assert data, "the agent closed the connection"
            self.received = self.framer.feed(data)
        message = self.received.pop(0)
        version, kind, length, xid = HEADER.unpack_from(message)
        return parse(DATAPATH, version, kind, length, xid, message)

    def answer(self, xid: int) -> Any:
        """Return the next message with this xid."""
        while (message := self.next()).xid != xid:
            pass
        return message

    def silent(self) -> bool:
        """Say that nothing comes within a tenth of a second."""
        return not self.received and not select.select([self.socket], [], [], 0.1)[0]

    def add_paths(self, xid: int, *paths: tuple[int, int], hard_timeout: int = 0) -> None:
        """Send a bundle that adds these paths, and then a barrier with this xid."""
        flags = ofp.OFPBF_ATOMIC | ofp.OFPBF_ORDERED
        self._control(xid, ofp.OFPBCT_OPEN_REQUEST, flags)
        for in_port, out_port in paths:
            output = parser.OFPActionOutput(out_port)
            apply = parser.OFPInstructionActions(ofp.OFPIT_APPLY_ACTIONS, [output])
            entry = parser.OFPFlowMod(
                DATAPATH,
                hard_timeout=hard_timeout,
                match=parser.OFPMatch(in_port=in_port),
                instructions=[apply],
            )
            entry.set_xid(xid)
            self.send(parser.OFPBundleAddMsg(DATAPATH, xid, flags, entry, []), xid)
        self._control(xid, ofp.OFPBCT_COMMIT_REQUEST, flags)
        self.send(parser.OFPBarrierRequest(DATAPATH), xid + 1)

    def _control(self, xid: int, kind: int, flags: int) -> None:
        self.send(parser.OFPBundleCtrlMsg(DATAPATH, xid, kind, flags, []), xid)


class Switch:
    """A bridge with its agent, and all that they talk to."""

    def __init__(self, folder: Path) -> None:
        self.dispatcher = Dispatcher(folder / "dispatcher.sock")
        self.controller = Controller()
        with socket.create_server(("127.0.0.1", 0)) as probe:
            self.port = probe.getsockname()[1]
        self.config = folder / "agent.json"
        AgentConfig(
            switch="q1",
            listen=f"127.0.0.1:{self.port}",
            controllers=[f"127.0.0.1:{self.controller.port}"],
            management=f"/var/run/openvswitch/{BRIDGE}.mgmt",
            dispatcher=str(self.dispatcher.path),
            token=TOKEN,
            fiber_ports=FIBER_PORTS,
        ).write(self.config)
        self.log = folder / "agent.log"
        self.agents: list[subprocess.Popen[str]] = []

    @property
    def agent(self) -> subprocess.Popen[str]:
        """The agent that was started last."""
        return self.agents[-1]

    def start_agent(self) -> None:
        """Start the agent and wait until it is ready."""
        command = [sys.executable, "-m", "qswitch_agent", "--config", str(self.config)]
        with self.log.open("a") as log:
            self.agents.append(
                subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True, cwd=ROOT)
            )
        assert self.agent.stdout is not None
        lines: queue.Queue[str] = queue.Queue()
        threading.Thread(
            target=lambda out: lines.put(out.readline()), args=[self.agent.stdout]
        ).start()
        assert lines.get(timeout=DEADLINE_S) == "ready\n", self.log.read_text()

    def end_agent(self, number: int = signal.SIGTERM) -> int:
        """Signal the agent and return its exit status."""
        self.agent.send_signal(number)
        return self.ended()

    def ended(self) -> int:
        """Wait for the agent's end and return its exit status."""
        status = self.agent.wait(DEADLINE_S)
        assert self.agent.stdout is not None
        self.agent.stdout.close()
        return status

    def close(self) -> None:
        """End whatever still runs."""
        for agent in self.agents:
            if agent.poll() is None:
                agent.kill()
                self.ended()
        self.dispatcher.open.set()
        self.dispatcher.server.stop(None).wait()
        self.controller.socket.close()
        self.controller.listener.close()

    def connects(self, *paths: tuple[int, int]) -> None:
        """Wait until these are the cross-connects."""
        wanted = sorted(paths)
        wait_until(lambda: self.dispatcher.sets[-1] == wanted, f"cross-connects {wanted}")


def veth_names() -> list[str]:
    return [f"{BRIDGE}v{port}" for port in FIBER_PORTS]


@pytest.fixture
def switch(tmp_path: Path) -> Iterator[Switch]:
    """A bridge of four fibre ports whose agent is ready and whose controller is connected."""
    names = veth_names()
    for near, far in zip(names[::2], names[1::2], strict=True):
        run("ip", "link", "add", near, "type", "veth", "peer", "name", far)
        for name in (near, far):
            run("ip", "link", "set", name, "up")
    switch = Switch(tmp_path)
    try:
        bridge = [f"add-br {BRIDGE}", f"set bridge {BRIDGE} datapath_type=netdev"]
        bridge += [f"set bridge {BRIDGE} protocols=OpenFlow14 fail_mode=secure"]
        for port, name in zip(FIBER_PORTS, names, strict=True):
            bridge += [f"add-port {BRIDGE} {name}", f"set interface {name} ofport_request={port}"]
        run("ovs-vsctl", *" -- ".join(bridge).split())
        switch.start_agent()
        run("ovs-vsctl", "set-controller", BRIDGE, f"tcp:127.0.0.1:{switch.port}")
        switch.controller.accept()
        yield switch
        if switch.agent.poll() is None:
            assert switch.end_agent() == 0, switch.log.read_text()
    finally:
        switch.close()
        run("ovs-vsctl", "--if-exists", "del-br", BRIDGE)
        for near in names[::2]:
            run("ip", "link", "del", near)


def test_a_cut_fibre_is_dark_also_for_an_agent_that_starts_later(switch: Switch) -> None:
    switch.controller.add_paths(10, (1, 3), (3, 1), (4, 2))
    switch.connects((1, 3), (3, 1), (4, 2))
    run("ip", "link", "set", veth_names()[0], "down")  # its peer, port 2, loses its carrier
    switch.connects()
    assert switch.end_agent() == 0
    switch.start_agent()
    assert switch.dispatcher.sets[-1] == []
    run("ip", "link", "set", veth_names()[0], "up")
    switch.connects((1, 3), (3, 1), (4, 2))


def test_barrier_is_answered_after_the_hardware(switch: Switch) -> None:
    switch.dispatcher.open.clear()
    switch.controller.add_paths(10, (1, 2), (3, 4))
    wait_until(lambda: switch.dispatcher.asked == 2, "the agent to ask for cross-connects")
    assert switch.controller.answer(10).type == ofp.OFPBCT_OPEN_REPLY
    assert switch.controller.answer(10).type == ofp.OFPBCT_COMMIT_REPLY
    assert switch.controller.silent()
    switch.dispatcher.open.set()
    assert isinstance(switch.controller.answer(11), parser.OFPBarrierReply)
    assert switch.dispatcher.sets == [[], [(1, 2), (3, 4)]]
    assert switch.dispatcher.tokens == {TOKEN}


def test_each_bundle_is_in_place_when_its_barrier_is_answered(switch: Switch) -> None:
    for turn in range(200):
        path = (1, 2 + turn % 3)
        switch.controller.add_paths(2 * turn + 100, path)
        assert isinstance(switch.controller.answer(2 * turn + 101), parser.OFPBarrierReply)
        assert switch.dispatcher.sets[-1] == [path]


def test_hard_timeout_closes_the_path(switch: Switch) -> None:
    switch.controller.add_paths(10, (1, 2), hard_timeout=1)
    switch.controller.answer(11)
    switch.connects((1, 2))
    switch.connects()


def test_entries_deleted_by_hand_close_their_path(switch: Switch) -> None:
    switch.controller.add_paths(10, (1, 2), (2, 1))
    switch.controller.answer(11)
    flows("del-flows", "in_port=1")
    switch.connects((2, 1))


def test_entry_modified_by_hand_moves_its_path(switch: Switch) -> None:
    flows("add-flow", "in_port=1,actions=output:2")
    flows("mod-flows", "in_port=1,actions=output:3")
    switch.connects((1, 3))


def test_restarted_agent_restores_the_paths(switch: Switch) -> None:
    switch.controller.add_paths(10, (1, 2), (4, 3))
    switch.controller.answer(11)
    assert switch.end_agent() == 0
    flows("del-flows", "in_port=4")
    switch.start_agent()
    switch.connects((1, 2))
    switch.controller.accept()


def test_paths_survive_the_controller(switch: Switch) -> None:
    switch.controller.add_paths(10, (1, 2))
    switch.controller.answer(11)
    switch.controller.socket.close()
    switch.controller.accept()
    switch.controller.add_paths(20, (3, 4))
    switch.controller.answer(21)
    assert switch.dispatcher.sets == [[], [(1, 2)], [(1, 2), (3, 4)]]


def test_refusal_of_the_hardware_answers_the_barrier_with_an_error(switch: Switch) -> None:
    switch.dispatcher.failure = grpc.StatusCode.INVALID_ARGUMENT
    switch.controller.add_paths(10, (1, 2))
    error = switch.controller.answer(11)
    assert (error.msg_type, error.type) == (ofp.OFPT_ERROR, ofp.OFPET_FLOW_MOD_FAILED)
    assert HEADER.unpack(error.data)[1::2] == (ofp.OFPT_BARRIER_REQUEST, 11)
    switch.dispatcher.failure = None
    switch.controller.add_paths(20, (1, 3))
    assert isinstance(switch.controller.answer(21), parser.OFPBarrierReply)
    assert switch.dispatcher.sets[-1] == [(1, 3)]


def test_two_paths_into_one_port_are_an_error(switch: Switch) -> None:
    switch.controller.add_paths(10, (1, 3), (2, 3))
    assert switch.controller.answer(11).msg_type == ofp.OFPT_ERROR
    assert switch.dispatcher.sets[-1] == [(1, 3)]


def test_failing_dispatcher_ends_the_agent_after_an_error(switch: Switch) -> None:
    switch.dispatcher.failure = grpc.StatusCode.UNAVAILABLE
    switch.controller.add_paths(10, (1, 2))
    assert switch.controller.answer(11).msg_type == ofp.OFPT_ERROR
    assert switch.ended() == 1
    assert "does not answer" in switch.log.read_text().splitlines()[-1]


def test_lost_dispatcher_ends_the_idle_agent(switch: Switch) -> None:
    switch.dispatcher.server.stop(None).wait()
    assert switch.ended() == 1
    assert "dispatcher at" in switch.log.read_text().splitlines()[-1]


def test_lost_bridge_ends_the_agent(switch: Switch) -> None:
    run("ovs-vsctl", "del-br", BRIDGE)
    assert switch.ended() == 1
    assert f"{BRIDGE}.mgmt is gone" in switch.log.read_text().splitlines()[-1]


def test_thousands_of_entries_at_once_are_all_seen(switch: Switch, tmp_path: Path) -> None:
    entries = [f"priority={number},in_port=1,actions=output:2\n" for number in range(1, 20001)]
    (tmp_path / "flows").write_text("".join(entries) + "priority=1,in_port=3,actions=output:4\n")
    run("ovs-ofctl", "-O", "OpenFlow14", "--bundle", "add-flows", BRIDGE, str(tmp_path / "flows"))
    switch.controller.send(parser.OFPBarrierRequest(DATAPATH), 9)
    assert isinstance(switch.controller.answer(9), parser.OFPBarrierReply)
    assert switch.dispatcher.sets[-1] == [(1, 2), (3, 4)]
    flows("del-flows", "in_port=1")
    switch.connects((3, 4))
