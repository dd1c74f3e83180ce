"""Where the product reads the wall clock, or waits by it: all else counts time of the network.

In stepped time a wait by the wall ends at an instant that the machine decides.
"""

import ast
from collections.abc import Iterator
from pathlib import Path

from test_structure import ROOT, parsed, sources

ROOMS = (
    *("wire", "programs", "gate", "dispatcher", "hosts", "controller_apps", "qswitch_agent"),
    *("copper", "applications", "evidence", "topologies", "qmn", "views"),
)
# Programs on a NetworkLoop, whose pauses and time-outs count time of the network.
ON_NETWORK_LOOP = (
    *("hosts/", "evidence/traffic/"),
    *(f"applications/{name}/" for name in ("keys", "key_distribution", "processing_unit")),
)
CLOCKS = {"time.monotonic", "time.monotonic_ns", "time.time", "time.time_ns"}
PAUSES = {"time.sleep", "hub.sleep", "wall_sleep", "wall_timeout", "network_loop.wall_timeout"}
OF_LOOPS = {f"asyncio.{name}" for name in ("sleep", "timeout", "timeout_at", "wait", "wait_for")}
LATER = {"call_later", "call_at"}

# Files and folders of which all that waits is of no stepped network.
APART = {
    "applications/ip_over_light/": "paced: tunnels of the kernel have timers of their own",
    "applications/vpn/": "paced: so have VPNs",
    "evidence/attacks/": "paced: attackers go by the wall",
    "evidence/bench/": "measures what the machine takes",
    "evidence/kinds/bench.py": "likewise",
    "evidence/curves/": "has no network; its workers are processes",
    "views/": "serves those outside the network, or draws what a run has left",
    "topologies/networks/iperf.py": "paced: iperf goes by the wall",
    "topologies/system/": "begins, asks or ends what is of this machine, or another",
    "applications/instruments/scpi.py": "paced: instruments run in real time",
    "gate/gate.py": "is what steps the time",
    "wire/network_time.py": "is the clock, where the wall paces it",
    "programs/network_timers.py": "likewise its timers",
    "programs/network_waits.py": "likewise its pauses",
    "dispatcher/clock.py": "likewise that of light",
    "hosts/network_loop.py": "likewise that of hosts",
}
BOUNDS = "bounds software while time stands: what it waits for needs none"
NUMBERS = "a number that grows, from one program to the next that takes its place"
LOGS = "of logs"
SERVES = "serves those outside the network"
BEGINS = "begins or ends a program"
LOOKS = "the runner looks at its network"
MACHINE = "guards what this machine does, or another"
PERSON = "for a person at the prompt"
ALLOWED = {
    "applications/keys/job.py": {"watch": "the runner looks, and says how far time may pass"},
    "applications/keys/key_client.py": {"KeyClient._ask": BOUNDS},
    "applications/keys/key_relays.py": {"KeyRelays._send": NUMBERS},
    "applications/keys/routes.py": {"Routes._send": NUMBERS},
    "applications/netqasm/round_end.py": {"RoundEnd.wait": "of a socket of texts.py"},
    # Python's clock is replaced there: process_time.py.
    "applications/netqasm/texts.py": {
        "Exchange.wait_for": "network",
        "Exchange._listen": "network",
        "Exchange._greet": BOUNDS,
        "Socket.__init__": "network",
        "Socket.recv": "network",
        "Socket._connect": "network; that of the kernel is tried again",
        "BroadcastChannel.recv": "network",
    },
    "applications/sabot_server/client.py": {"RemoteSabot._call": BOUNDS},
    "applications/sabot_server/sabot_servicer.py": {"serving": BEGINS},
    "applications/telemetry/service.py": {"Telemetry._told": SERVES, "Telemetry._due": SERVES},
    "controller_apps/__main__.py": {"wait_until_listening": BEGINS},
    "controller_apps/apps/device_monitor.py": {"DeviceMonitor._next_number": NUMBERS},
    "controller_apps/apps/quantum_metadata.py": {"QuantumMetadata.__init__": LOGS},
    "controller_apps/apps/ticks.py": {"Ticks.wait": "where the wall paces time"},
    "controller_apps/console/console.py": {"_serve": SERVES},
    "controller_apps/console/metrics.py": {"_head": SERVES},
    "controller_apps/console/questions.py": {"EventQuestion.wait": SERVES},
    "copper/forwarder.py": {
        "Forwarder.__init__": "where the wall paces time",
        "Forwarder.run": "where the wall paces time, or for acknowledgements that nobody awaits",
        "Forwarder._wait_s": "where the wall paces time",
    },
    "dispatcher/layer/history.py": {"History._write": "gathers events for a file"},
    "dispatcher/server/server.py": {"Server.stop": BEGINS},
    "dispatcher/server/servicer.py": {"Service.Watch": SERVES},
    "hosts/client.py": {"End.close": BOUNDS, "_wait": LOOKS},
    "hosts/hardware/announce.py": {"announce": NUMBERS},
    "hosts/hardware/orders.py": {"proved": BOUNDS},
    "hosts/hardware/simulated.py": {"SimulatedQnic.look": BOUNDS},
    "hosts/node_agent.py": {"NodeAgent._send": NUMBERS},
    "hosts/service_socket.py": {"ServiceSocket._wait_until_broken_off": BOUNDS},
    "hosts/stack_socket.py": {
        f"StackSocket.{name}": "as its caller says" for name in ("settimeout", "accept")
    },
    "programs/connection_shares.py": {"LocalUsers.owner": SERVES, "keep_shares": SERVES},
    "programs/metrics_server.py": {"_answer": SERVES},
    "qswitch_agent/bridge.py": {"Connection.barrier": BOUNDS, "Monitor.synchronise": BOUNDS},
    "qswitch_agent/hardware/simulated.py": {
        f"SimulatedSwitch.{name}": BOUNDS for name in ("_outcome", "tune", "read", "emit", "keep")
    },
    "qswitch_agent/light_paths.py": {"LightPaths._bring_up_to_date": LOGS},
    "qswitch_agent/proxy/link.py": {
        "Link.show_soon": "gathers replies, where the wall paces time",
        "Link.answer": "orders messages of the bridge",
        "Link.fail": "orders messages of the bridge",
        "Link._own_barrier": BOUNDS,
    },
    "qswitch_agent/proxy/proxy.py": {
        "Server.close": BEGINS,
        "Server._hear": "orders messages of the bridge",
        "Proxy._dial": BEGINS,
    },
    "qswitch_agent/switch.py": {
        "Switch.started": BEGINS,
        "Switch.synchronise": "orders messages of the bridge",
        "Switch.read": "orders messages of the bridge",
    },
    "evidence/traffic/driver.py": {"_checking": LOOKS},
    "topologies/links/slow_copper.py": {"_run": MACHINE},
    "topologies/networks/captures.py": {"Captures.end": MACHINE, "Captures.wait": BEGINS},
    "topologies/networks/discovery.py": {"Discovery._wait": BEGINS, "heard_again": LOOKS},
    "topologies/networks/disk.py": {"DiskKeeper._watch": MACHINE},
    "topologies/networks/heard_orders.py": {"until_heard.wait": LOOKS},
    "topologies/networks/long_start.py": {
        f"LongStart.{name}": PERSON for name in ("__init__", "waits_for")
    },
    "topologies/networks/network.py": {
        f"Network.{name}": LOOKS
        for name in ("check", "explain", "_require_none_stopped", "_require_others_for")
    },
    "topologies/networks/switch_watch.py": {"SwitchWatch.require_interfaces": LOOKS},
    "topologies/nodes/controller.py": {"QuantumController.start": BEGINS},
    "topologies/nodes/copper.py": {"connect_copper": BEGINS},
    "topologies/nodes/gate.py": {"Start.__init__": BEGINS},
    "topologies/nodes/optical_switch.py": {
        f"OpticalSwitch.{name}": BEGINS for name in ("launch", "start")
    },
    "qmn/changes/change.py": {"ask_dispatcher": BOUNDS},
    "qmn/interactive/network_cli.py": {
        f"NetworkCLI.{name}": PERSON for name in ("do_wait", "waitForNode")
    },
    # Patience is over only when the network's clock has come so far, too, or stands.
    "qmn/jobs/transfer.py": dict.fromkeys(
        ("Patience.renew", "Patience.is_over", "follow_all"), LOOKS
    ),
    "qmn/machines/workers.py": {"connected": MACHINE, "found_workers": MACHINE},
    "qmn/running/machine.py": {"_run": MACHINE},
    "qmn/scripting/network.py": {"QuantumNetwork.iperf.parts": "measures what the machine takes"},
    "qmn/scripting/own_run.py": {"_end": BEGINS, "_wait": BEGINS},
}


def waits(file: Path, name: str) -> set[str]:
    """Return the functions of a file that read the wall clock or wait by it."""
    loop_has_wall = not name.startswith(ON_NETWORK_LOOP)
    found = _uses(parsed(file), "")
    return {function for function, node in found if _is_by_wall(node, loop_has_wall)}


def _uses(node: ast.AST, within: str) -> Iterator[tuple[str, ast.AST]]:
    for child in ast.iter_child_nodes(node):
        place = within
        if isinstance(child, ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef):
            place = f"{within}.{child.name}".removeprefix(".")
        yield place, child
        yield from _uses(child, place)


def _is_by_wall(node: ast.AST, loop_has_wall: bool) -> bool:
    if isinstance(node, ast.Attribute):
        return ast.unparse(node) in CLOCKS
    if not isinstance(node, ast.Call):
        return False
    called, last = ast.unparse(node.func), ast.unparse(node.func).rpartition(".")[2]
    limit = _limit(node, called, last)
    if limit is None or ast.unparse(limit) in ("0", "0.0", "None"):
        return False
    if called == "timers.call_at":  # programs.network_timers
        return False
    return loop_has_wall or not (called in OF_LOOPS or last in LATER)


def _limit(call: ast.Call, called: str, last: str) -> ast.expr | None:
    """Return for how long a call waits by the wall at most; None if it does not."""
    named = [word.value for word in call.keywords if word.arg == "timeout"]
    if named and last != "Field":
        return named[0]
    first = next(iter(call.args), None)
    if called == "asyncio.wait":
        return None
    if called in PAUSES | OF_LOOPS or last in LATER | {"settimeout", "poll"}:
        return first
    if called == "select.select":
        return call.args[3] if len(call.args) > 3 else None
    if last == "create_connection":
        return call.args[1] if len(call.args) > 1 else None
    if last in ("wait", "wait_for", "join", "communicate") and call.args:
        text = ast.unparse(call.args[-1])
        return call.args[-1] if text.endswith(("_S", "_s")) else None
    return None


def test_no_program_of_a_network_waits_by_the_wall_but_for_a_reason() -> None:
    for room in ROOMS:
        for file in sources(room):
            name = str(file.relative_to(ROOT))
            if not name.startswith(tuple(APART)):
                assert waits(file, name) == set(ALLOWED.get(name, {})), name


def test_what_waits_by_the_wall_is_found(tmp_path: Path) -> None:
    file = tmp_path / "some.py"
    lines = {
        "time.sleep(3)": True,
        "asyncio.sleep(PAUSE_S)": True,
        "asyncio.sleep(0)": False,
        "asyncio.timeout(LIMIT_S)": True,
        "asyncio.timeout(None)": False,
        "changed.wait(timeout=left)": True,
        "changed.wait(LIMIT_S)": True,
        "changed.wait()": False,
        "select.select([], [], [], left_s)": True,
        "select.select([], [], [])": False,
        "files.poll(1e3 * left_s)": True,
        "files.poll()": False,
        "connection.settimeout(None)": False,
        "connection.settimeout(LIMIT_S)": True,
        "f(time.monotonic)": True,
        "loop.call_later(3, f)": True,
        "stub.Look(request, timeout=LIMIT_S)": True,
    }
    for number, (line, is_found) in enumerate(lines.items()):
        file.with_stem(f"some{number}").write_text(f"def some():\n    {line}\n")
        assert bool(waits(file.with_stem(f"some{number}"), "dispatcher/x.py")) == is_found, line
    assert waits(file.with_stem("some1"), "hosts/x.py") == set()
