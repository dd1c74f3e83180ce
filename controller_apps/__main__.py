"""Start the controller: `python -m controller_apps --config FILE`."""

import argparse
import contextlib
import gc
import logging
import os
import signal
import socket
import sys
import time
import warnings
from functools import partial
from pathlib import Path
from typing import Any

from controller_apps.policy.reading import BadPolicy, read_policy
from controller_apps.timeouts import NO_ECHO_S, READY_POLL_S, READY_TIMEOUT_S
from programs.faults import report_fault
from wire.config import BadConfig, ControllerConfig
from wire.network_time import SteppedTime

APPS = ("learning_switch", "quantum_metadata", "device_monitor")
# The controller asks for no names: without its own resolver eventlet loads much faster.
os.environ.setdefault("EVENTLET_NO_GREENDNS", "yes")
WSGI_APPS = {"ryu.app.ofctl_rest", "ryu.app.rest_topology"}


class Fatal(Exception):
    """The controller cannot run; the message names value and remedy."""


def main() -> int:
    """Run until a signal to end; return the exit status."""
    gc.disable()  # until all is loaded, which stays
    options = argparse.ArgumentParser(prog="controller_apps", description=__doc__)
    options.add_argument("--config", type=Path, required=True, help="a ControllerConfig in JSON")
    text = "load it before the configuration is read, which says the same"
    options.add_argument("--framework", metavar="NAME", help=text)
    text = "read the configuration when the writing end of this pipe is closed"
    options.add_argument("--after", type=int, metavar="DESCRIPTOR", help=text)
    logging.basicConfig(
        stream=sys.stderr, level=logging.INFO, format="%(asctime)s %(name)s: %(message)s"
    )
    arguments = options.parse_args()
    try:
        if arguments.framework is not None:
            load_framework(arguments.framework)
        if arguments.after is not None:
            with open(arguments.after, "rb", buffering=0) as held:
                held.read()
        run(ControllerConfig.read(arguments.config))
    except (BadConfig, BadPolicy, Fatal) as error:
        return report_fault(f"controller: {error}")
    return 0


def run(config: ControllerConfig) -> None:
    read_policy(config.policy)  # the apps read it; errors are reported before they start
    framework = load_framework(config.framework)
    host, port = read_address("listen", config.listen)
    check_free("listen", host, port)
    prepare(framework, config, host, port)
    app = start_apps(framework, config)
    wait_until_listening(framework, host, port)
    stop = stop_socket()
    gc.freeze()
    gc.enable()
    print("ready", flush=True)
    stop.recv(1)
    app.close()


def load_framework(name: str) -> Any:
    """Load the framework that the configuration names, before any app is imported.

    Raise Fatal for one that is unknown, or where another was loaded before.
    """
    os.environ["QMN_CONTROLLER_FRAMEWORK"] = name
    if name == "ryu":
        wait_by_eventlet()
    try:
        from controller_apps.openflow import framework
    except ValueError as error:
        raise Fatal(str(error)) from error
    if name != framework.NAME:
        raise Fatal(f"framework {name!r}: this process has loaded {framework.NAME} already")
    framework.hub.patch()
    return framework


def wait_by_eventlet() -> None:
    """Let all that waits do it by Ryu's eventlet, as `ryu-manager` does: before Ryu is loaded.

    Eventlet looks for locks in all that is loaded, which takes longer when there is more of it.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # its own deprecation: nothing to do about it
        import eventlet
    eventlet.monkey_patch()


def prepare(framework: Any, config: ControllerConfig, host: str, port: int) -> None:
    """Load what is not ours and set where everything listens."""
    rest = read_address("rest", config.rest) if config.rest else None
    if rest is not None:
        if config.rest_fd is None:
            check_free("rest", *rest)
    elif WSGI_APPS.intersection(config.apps):
        raise Fatal(f"apps {', '.join(config.apps)} serve HTTP: say where, by `rest`")
    try:
        framework.load_stock_apps(config.apps)
        # Time that is stepped must not go on for what the wall paces.
        echoes = {"echo_period_s": NO_ECHO_S} if isinstance(config.time, SteppedTime) else {}
        framework.serve_on(host, port, rest, config.rest_fd, **echoes)
        framework.serve_quickly()
    except ValueError as error:
        raise Fatal(str(error)) from error


def read_address(name: str, address: str) -> tuple[str, int]:
    """Split "127.0.0.1:6653"."""
    host, _, port = address.rpartition(":")
    if not host or not port.isdecimal() or not 0 < int(port) < 1 << 16:
        raise Fatal(f"{name} {address!r} is not an address and a port, such as 127.0.0.1:6653")
    return host, int(port)


def check_free(name: str, host: str, port: int) -> None:
    """Fail now if the address cannot be had: the framework would only log it and go on."""
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
            probe.listen()
        except OSError as error:
            raise Fatal(
                f"cannot listen on {host}:{port}: {error.strerror}; "
                f"end the other controller or set another `{name}`"
            ) from error


def start_apps(framework: Any, config: ControllerConfig) -> Any:
    """Start the apps, the OpenFlow server and the console; return the quantum-metadata app."""
    from controller_apps.console.console import Console
    from controller_apps.console.facts import PACKAGE_APPS, Facts
    from controller_apps.console.guard import Guard
    from controller_apps.openflow.mac_table import MacTable
    from controller_apps.record import Record
    from controller_apps.sessions.state_folder import StateFolder

    try:
        state = StateFolder(config.state)
    except OSError as error:
        raise Fatal(f"cannot use the state folder {config.state!r}: {error.strerror}") from error
    metrics = open_metrics(config)
    try:
        kind = metrics.record if metrics else Record
        record = kind(config.record, config.time)
    except OSError as error:
        raise Fatal(f"cannot write the record {config.record!r}: {error.strerror}") from error
    try:
        console = Console(config.console) if config.console else None
    except OSError as error:
        raise Fatal(f"cannot open the console {config.console!r}: {error.strerror}") from error
    modules = [f"controller_apps.apps.{name}" for name in APPS]
    modules += [app.module for app in PACKAGE_APPS]
    modules += ["controller_apps.console.rest"] if config.rest else []
    modules += config.apps
    guard = partial(Guard, address=config.rest, token=config.rest_token)
    apps = framework.start(
        modules, guard, config=config, mac_table=MacTable(), record=record, state=state
    )
    packages = {app.name: apps[app.attr] for app in PACKAGE_APPS}
    facts = Facts(apps["QuantumMetadata"], apps["DeviceMonitor"], packages)
    for server in (console, metrics):
        if server is not None:
            server.start(facts)
    return apps["QuantumMetadata"]


def open_metrics(config: ControllerConfig) -> Any:
    """Return what tells Prometheus the controller's metrics; None if that is not configured."""
    if config.metrics_fd is None:
        return None
    from controller_apps.console.metrics import Metrics

    return Metrics(config.metrics_fd)


def wait_until_listening(framework: Any, host: str, port: int) -> None:
    deadline = time.monotonic() + READY_TIMEOUT_S
    while time.monotonic() < deadline:
        framework.hub.sleep(READY_POLL_S)
        with contextlib.suppress(ConnectionRefusedError), socket.create_connection((host, port)):
            return
    raise Fatal(f"no OpenFlow server on {host}:{port} within {READY_TIMEOUT_S} s")


def stop_socket() -> socket.socket:
    """Return a socket that becomes readable when the process gets a signal to end.

    Both frameworks can wait for a socket; under eventlet a handler could not wake the hub.
    """
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    signal.set_wakeup_fd(writer.detach())
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: None)
    return reader


if __name__ == "__main__":
    status = main()
    sys.stdout.flush()
    # Threads that wait for switches cannot be interrupted; the kernel closes their sockets.
    os._exit(status)
