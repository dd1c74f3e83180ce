"""The agent as a program, between a real Open vSwitch bridge and a controller of the test's own.

The dispatcher is a gRPC server that says what the test says, so that it can be slow or fail.
"""

import os
import queue
import re
import select
import shutil
import signal
import socket
import socketserver
import subprocess
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import grpc
import pytest
from conftest import open_vswitch
from limits import SOON_S
from limits import wait_until as wait_until
from loaded import Running, forks
from os_ken.ofproto import ofproto_v1_4 as ofp
from os_ken.ofproto import ofproto_v1_4_parser as parser
from os_ken.ofproto.ofproto_parser import msg as parse
from os_ken.ofproto.ofproto_protocol import ProtocolDesc

from qswitch_agent.openflow.messages import HEADER, Framer
from topologies.system.open_vswitch.openvswitch import management
from topologies.system.processes.programs import python
from topologies.system.runs.runtime import free_port
from wire import dispatcher_pb2 as pb
from wire import dispatcher_service, optical
from wire.analyser_frames import AnalyserCounts, MemoryCounts
from wire.config import AgentConfig
from wire.dispatcher_service import cross_connects_socket

LLDP = bytes.fromhex("0180c200000e0a00000000aa88cc") + bytes(46)
PING = bytes.fromhex("ffffffffffff0a00000000aa0800") + bytes(46)
FLAGS = ofp.OFPBF_ATOMIC | ofp.OFPBF_ORDERED
APPLY, WRITE = ofp.OFPIT_APPLY_ACTIONS, ofp.OFPIT_WRITE_ACTIONS
DEADLINE_S = SOON_S
FIBER_PORTS = [1, 2, 3, 4]
DATAPATH = ProtocolDesc(version=ofp.OFP_VERSION)
BRIDGE = f"qat{os.getpid()}"
TOKEN = "0f1e2d"
RENEWING = 1 << 30  # a transaction id of no test

needs_open_vswitch = pytest.mark.skipif(
    os.geteuid() != 0 or shutil.which("ovs-vsctl") is None,
    reason="needs root and Open vSwitch",
)


def run(*command: str) -> str:
    """Run a command and return what it printed."""
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def flows(*arguments: str) -> str:
    """Run ovs-ofctl on the bridge."""
    verb, *rest = arguments
    return run("ovs-ofctl", "-O", "OpenFlow14", verb, BRIDGE, *rest)


class Agents(socketserver.ThreadingUnixStreamServer):
    """The dispatcher's socket for cross-connects."""

    daemon_threads = True
    block_on_close = False

    def __init__(self, path: str, dispatcher: "Dispatcher") -> None:
        super().__init__(path, AgentHandler)
        self.dispatcher = dispatcher


class AgentHandler(socketserver.StreamRequestHandler):
    """Answers one agent until it goes away."""

    server: Agents

    def handle(self) -> None:
        token = self._message().decode()
        while message := self._message():
            request = pb.CrossConnectRequest.FromString(message)
            outcome = self.server.dispatcher.cross_connect(token, request)
            self.wfile.write(dispatcher_service.encode(outcome.SerializeToString()))

    def _message(self) -> bytes:
        length = self.rfile.read(dispatcher_service.LENGTH.size)
        return self.rfile.read(*dispatcher_service.LENGTH.unpack(length)) if length else b""


class Dispatcher:
    """Records each set of cross-connects when it answers; passes may be withheld."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.asked = self.watched = 0
        self.sets: list[list[tuple[int, int]]] = []
        self.tokens: set[Any] = set()
        self.failure: grpc.StatusCode | None = None
        self.refused: set[tuple[int, int]] = set()  # paths; a set with one of them is refused
        self.open = threading.Event()
        self.open.set()
        self.readings = pb.SwitchStatisticsReply()
        self.circuits: dict[tuple[int, int], int] = {}  # of the newest set
        self.tuned: list[pb.TunePortRequest] = []
        self.condition = pb.SwitchCondition(
            loss_db=0.5,
            rotation=1,
            min_frequency_mhz=191_350_000,
            max_frequency_mhz=196_100_000,
            grid_mhz=50_000,
            min_power_dbm=-20,
        )
        self.conditions: queue.Queue[pb.SwitchCondition] = queue.Queue()
        self.ended = threading.Event()
        unary: dict[str, tuple[Any, Any]] = {
            "TunePort": (self._tune, pb.TunePortRequest),
            "SwitchStatistics": (self._statistics, pb.SwitchStatisticsRequest),
        }
        handlers = {
            name: grpc.unary_unary_rpc_method_handler(
                method,
                request_deserializer=request.FromString,
                response_serializer=lambda reply: reply.SerializeToString(),
            )
            for name, (method, request) in unary.items()
        }
        handlers["WatchSwitch"] = grpc.unary_stream_rpc_method_handler(
            self._watch,
            request_deserializer=pb.WatchSwitchRequest.FromString,
            response_serializer=pb.SwitchCondition.SerializeToString,
        )
        handler = grpc.method_handlers_generic_handler("qmn.Dispatcher", handlers)
        self.server = grpc.server(ThreadPoolExecutor(8))
        self.server.add_generic_rpc_handlers((handler,))
        self.server.add_insecure_port(f"unix:{path}")
        self.server.start()
        self.agents = Agents(cross_connects_socket(str(path)), self)
        # It looks this often whether it is to end.
        threading.Thread(target=self.agents.serve_forever, args=[0.01], daemon=True).start()

    def cross_connect(self, token: str, request: pb.CrossConnectRequest) -> pb.CrossConnectOutcome:
        """Answer an agent."""
        self.asked += 1
        self.tokens.add(token)
        assert self.open.wait(DEADLINE_S)
        failure = self.failure
        if self.refused.intersection((one.in_port, one.out_port) for one in request.connections):
            failure = grpc.StatusCode.FAILED_PRECONDITION
        if failure is not None:
            return pb.CrossConnectOutcome(code=failure.value[0], text="the mirror is stuck")
        self.circuits = {(one.in_port, one.out_port): one.circuit for one in request.connections}
        self.sets.append(sorted(self.circuits))
        return pb.CrossConnectOutcome(ready_ns=time.time_ns())

    def _tune(self, request: pb.TunePortRequest, _context: Any) -> pb.TunePortReply:
        self.tuned.append(request)
        return pb.TunePortReply(ready_ns=time.time_ns())

    def _statistics(self, _request: Any, _context: Any) -> pb.SwitchStatisticsReply:
        return self.readings

    def _watch(self, _request: Any, context: Any) -> Iterator[pb.SwitchCondition]:
        self.watched += 1
        yield self.condition
        while context.is_active() and not self.ended.is_set():
            try:
                yield self.conditions.get(timeout=0.05)
            except queue.Empty:
                continue

    def changes(self, condition: pb.SwitchCondition) -> None:
        """Tell the agent of another condition."""
        self.condition = condition
        self.conditions.put(condition)

    def passed(self, photons: int, *path: int, ahead_s: float = 0.0) -> None:
        """Let this many photons have passed a path by now, or by a moment that is to come."""
        circuit = self.circuits[path[0], path[1]]
        now_ns = time.time_ns() + round(ahead_s * 1e9)
        reading = pb.SwitchStatisticsReply.Circuit(
            circuit=circuit, photons=photons, since_ns=now_ns, last_ns=now_ns
        )
        kept = [one for one in self.readings.circuits if one.circuit != circuit]
        ports, temperature = self.readings.ports, self.readings.temperature_c
        self.readings = pb.SwitchStatisticsReply(
            circuits=[*kept, reading], ports=ports, temperature_c=temperature
        )

    def stop(self) -> None:
        """End the server."""
        self.ended.set()
        self.agents.shutdown()
        self.agents.server_close()
        self.server.stop(None).wait()


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
        self.greet()

    def greet(self) -> None:
        self.framer, self.received = Framer(), list[bytes]()
        self.send(parser.OFPHello(DATAPATH), 1)
        assert isinstance(self.next(), parser.OFPHello)

    def agree(self) -> None:
        """Wait until the bridge has taken our HELLO: before that, it reports no port."""
        self.send(parser.OFPBarrierRequest(DATAPATH), 2)
        assert isinstance(self.answer(2), parser.OFPBarrierReply)

    def send(self, message: Any, xid: int) -> None:
        message.set_xid(xid)
        message.serialize()
        self.socket.sendall(bytes(message.buf))

    def next(self) -> Any:
        """Return the next message but echo requests, decoded by os_ken."""
        message = self.next_bytes()
        version, kind, length, xid = HEADER.unpack_from(message)
        return parse(DATAPATH, version, kind, length, xid, message)

    def next_bytes(self) -> bytes:
        """Return the next message but echo requests."""
        while not self.received:
            self._receive()
        return self.received.pop(0)

    def _receive(self) -> None:
        data = self.socket.recv(65536)
        assert data, "the agent closed the connection"
        self.received = [one for one in self.framer.feed(data) if not self._echoed(one)]

    def _echoed(self, message: bytes) -> bool:
        """Answer an echo request, which the bridge sends when it has heard nothing for long."""
        if message[1] != ofp.OFPT_ECHO_REQUEST:
            return False
        self.socket.sendall(message[:1] + bytes([ofp.OFPT_ECHO_REPLY]) + message[2:])
        return True

    def answer(self, xid: int) -> Any:
        """Return the next message with this xid."""
        while (message := self.next()).xid != xid:
            pass
        return message

    def silent(self) -> bool:
        """Say that nothing comes within a tenth of a second."""
        while not self.received and select.select([self.socket], [], [], 0.1)[0]:
            self._receive()
        return not self.received

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


class Operator(Controller):
    """One that connects to a switch's agent as ovs-ofctl does, until the end of a `with`."""

    def __init__(self, switch: str) -> None:
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.settimeout(DEADLINE_S)
        self.socket.connect(str(management(switch)))
        self.greet()

    def __enter__(self) -> "Operator":
        return self

    def __exit__(self, *_error: object) -> None:
        self.socket.close()

    def memories(self) -> list[MemoryCounts]:
        """Return the statistics of the switch's memories."""
        body = self._counts(optical.MEMORY_COUNTS)
        return [MemoryCounts(*counts) for counts in MemoryCounts.FIELDS.iter_unpack(body)]

    def analysers(self) -> list[AnalyserCounts]:
        """Return the counts of the switch's analysers and stations."""
        body = self._counts(optical.ANALYSER_COUNTS)
        return [AnalyserCounts(*counts) for counts in AnalyserCounts.FIELDS.iter_unpack(body)]

    def _counts(self, kind: int) -> bytes:
        ask = parser.OFPExperimenterStatsRequest
        self.send(ask(DATAPATH, 0, optical.EXPERIMENTER, kind, b""), 900)
        return bytes(self.answer(900).body.data)


class Switch:
    """A bridge with its agent, and all that they talk to."""

    def __init__(
        self, folder: Path, controllers: int, fiber_ports: Sequence[int] = FIBER_PORTS
    ) -> None:
        self.dispatcher = Dispatcher(folder / "dispatcher.sock")
        self.controllers = [Controller() for _ in range(controllers)]
        self.controller = self.controllers[0]
        self.port = free_port(controllers)
        self.config = folder / "agent.json"
        AgentConfig(
            switch="q1",
            listen=f"127.0.0.1:{self.port}",
            controllers=[f"127.0.0.1:{controller.port}" for controller in self.controllers],
            management=f"/var/run/openvswitch/{BRIDGE}.mgmt",
            dispatcher=str(self.dispatcher.path),
            token=TOKEN,
            fiber_ports=list(fiber_ports),
        ).write(self.config)
        self.log = folder / "agent.log"
        self.agents: list[Running] = []

    @property
    def agent(self) -> Running:
        """The agent that was started last."""
        return self.agents[-1]

    def start_agent(self) -> None:
        """Start the agent and wait until it is ready."""
        command = [python(), "-m", "qswitch_agent", "--config", str(self.config)]
        with self.log.open("a") as log:
            self.agents.append(forks().begin("q1-agent", command, log))
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
        self.agent.stdout.close()
        return status

    def close(self) -> None:
        """End whatever still runs."""
        for agent in self.agents:
            if agent.poll() is None:
                agent.kill()
                self.ended()
        self.dispatcher.open.set()
        self.dispatcher.stop()
        for controller in self.controllers:
            controller.socket.close()
            controller.listener.close()

    def renew(self) -> None:
        """Make it dark, as a new one; what a test has not spoiled is as it was."""
        self.dispatcher.refused = set()
        accepted(self.controller, flow_mod(None, command=ofp.OFPFC_DELETE), RENEWING)
        self.dispatcher.readings = pb.SwitchStatisticsReply()
        self.dispatcher.tuned.clear()
        self.dispatcher.sets, self.dispatcher.asked = [[]], 1

    def connects(self, *paths: tuple[int, int]) -> None:
        """Wait until these are the cross-connects."""
        wanted = sorted(paths)
        wait_until(lambda: self.dispatcher.sets[-1] == wanted, f"cross-connects {wanted}")


def veth_names() -> list[str]:
    return [f"{BRIDGE}v{port}" for port in FIBER_PORTS]


@contextmanager
def running_switch(
    folder: Path, controllers: int = 1, fiber_ports: Sequence[int] = FIBER_PORTS
) -> Iterator[Switch]:
    """A bridge of four fibre ports whose agent is ready, and its controllers are connected."""
    with open_vswitch():
        yield from _running_switch(folder, controllers, fiber_ports)


def _running_switch(folder: Path, controllers: int, fiber_ports: Sequence[int]) -> Iterator[Switch]:
    names, switch = veth_names(), Switch(folder, controllers, fiber_ports)
    for near, far in zip(names[::2], names[1::2], strict=True):
        run("ip", "link", "add", near, "type", "veth", "peer", "name", far)
        for name in (near, far):
            # Else the kernel says something of its own at any time.
            Path(f"/proc/sys/net/ipv6/conf/{name}/disable_ipv6").write_text("1")
            run("ip", "link", "set", name, "up")
    try:
        bridge = [f"add-br {BRIDGE}", f"set bridge {BRIDGE} datapath_type=netdev"]
        bridge += [f"set bridge {BRIDGE} protocols=OpenFlow14 fail_mode=secure"]
        for port, name in zip(fiber_ports, names, strict=True):
            bridge += [f"add-port {BRIDGE} {name}", f"set interface {name} ofport_request={port}"]
        run("ovs-vsctl", *" -- ".join(bridge).split())
        switch.start_agent()
        targets = [f"tcp:127.0.0.1:{switch.port + number}" for number in range(controllers)]
        run("ovs-vsctl", "set-controller", BRIDGE, *targets)
        for controller in switch.controllers:
            controller.accept()
            controller.agree()
        # A bridge that stands while other tests run hears nothing from its controllers for long.
        for row in re.findall(
            r"[0-9a-f-]{36}", run("ovs-vsctl", "get", "bridge", BRIDGE, "controller")
        ):
            run("ovs-vsctl", "set", "controller", row, "inactivity_probe=600000")
        yield switch
        if switch.agent.poll() is None:
            assert switch.end_agent() == 0, switch.log.read_text()
    finally:
        switch.close()
        run("ovs-vsctl", "--if-exists", "del-br", BRIDGE)
        for near in names[::2]:
            run("ip", "link", "del", near)


def outputs(*ports: int) -> Any:
    return parser.OFPInstructionActions(APPLY, [parser.OFPActionOutput(port) for port in ports])


def actions(*list_of_actions: Any) -> Any:
    return parser.OFPInstructionActions(APPLY, list(list_of_actions))


def flow_mod(in_port: int | None, *instructions: Any, **more: Any) -> Any:
    fields = {} if in_port is None else {"in_port": in_port}
    fields |= more.pop("fields", {})
    match = parser.OFPMatch(**fields)
    if more.get("command") in (ofp.OFPFC_DELETE, ofp.OFPFC_DELETE_STRICT):
        more |= {"out_port": ofp.OFPP_ANY, "out_group": ofp.OFPG_ANY}
    return parser.OFPFlowMod(DATAPATH, match=match, instructions=list(instructions), **more)


def light(in_port: int, out_port: int, **more: Any) -> Any:
    return flow_mod(in_port, outputs(out_port), **more)


def ask(controller: Controller, message: Any, xid: int) -> Any:
    """Send a request, then a barrier; return the error that came, or the barrier's answer."""
    controller.send(message, xid)
    controller.send(parser.OFPBarrierRequest(DATAPATH), xid + 1)
    while (answer := controller.next()).xid not in (xid, xid + 1):
        pass
    if answer.xid == xid:
        controller.answer(xid + 1)
    return answer


def refused(controller: Controller, message: Any, xid: int = 500) -> tuple[int, int]:
    """Return type and code of the error that answers a request."""
    answer = ask(controller, message, xid)
    assert isinstance(answer, parser.OFPErrorMsg), answer
    return answer.type, answer.code


def accepted(controller: Controller, message: Any, xid: int = 600) -> None:
    answer = ask(controller, message, xid)
    assert isinstance(answer, parser.OFPBarrierReply), (answer.type, answer.code)


def bundle(controller: Controller, xid: int, *members: Any) -> None:
    """Send members in a bundle; the xid of the first is xid + 1. Commit it with xid."""
    control = parser.OFPBundleCtrlMsg
    controller.send(control(DATAPATH, xid, ofp.OFPBCT_OPEN_REQUEST, FLAGS, []), xid)
    assert controller.answer(xid).type == ofp.OFPBCT_OPEN_REPLY
    for number, member in enumerate(members, xid + 1):
        member.set_xid(number)
        controller.send(parser.OFPBundleAddMsg(DATAPATH, xid, FLAGS, member, []), number)
    controller.send(control(DATAPATH, xid, ofp.OFPBCT_COMMIT_REQUEST, FLAGS, []), xid)


def committed(controller: Controller, xid: int, *members: Any) -> None:
    """Commit a bundle, and wait until light passes."""
    bundle(controller, xid, *members)
    assert controller.answer(xid).type == ofp.OFPBCT_COMMIT_REPLY
    controller.send(parser.OFPBarrierRequest(DATAPATH), xid - 1)
    assert isinstance(controller.answer(xid - 1), parser.OFPBarrierReply)


def entries(controller: Controller, xid: int = 700) -> list[Any]:
    """Return the flow statistics of table 0."""
    request = parser.OFPFlowStatsRequest(
        DATAPATH, 0, 0, ofp.OFPP_ANY, ofp.OFPG_ANY, 0, 0, parser.OFPMatch()
    )
    controller.send(request, xid)
    return list(controller.answer(xid).body)


def tuning(switch: Switch, port: int, frequency_mhz: int, power: int = 0, **more: Any) -> Any:
    """Return a PORT_MOD that tunes a port; power in dBm * 10."""
    address = Path(f"/sys/class/net/{veth_names()[port - 1]}/address").read_text().strip()
    optics = parser.OFPPortModPropOptical(
        type_=ofp.OFPPMPT_OPTICAL,
        configure=optical.TUNABLE,
        freq_lmda=frequency_mhz,
        fl_offset=0,
        grid_span=50_000,
        tx_pwr=power & 0xFFFFFFFF,
    )
    address = more.get("address", address)
    return parser.OFPPortMod(DATAPATH, port, address, 0, 0, [optics])
