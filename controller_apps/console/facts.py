"""Answers for console and REST: each is asked of the app that owns the facts, on its own thread."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from controller_apps.console import tapi
from controller_apps.console.questions import Refused, ask
from wire.device import setting_number
from wire.parameters.checks import remedy
from wire.registered import registered

# Apps of packages, as MODULE:CLASS, each by the name of the question that it answers.
PACKAGE_APPS = registered("qmn.controller_apps").values()


@dataclass(frozen=True)
class Facts:
    quantum: Any
    monitor: Any
    # Apps of packages, by the question that each answers.
    packages: Mapping[str, Any] = field(default_factory=dict)

    def devices(self) -> Any:
        """Return every device and its state, and what each host has announced that it can do."""
        features = ask(self.quantum, "node_features")
        unknown = {"features": None, "memory_qubits": None}
        return [
            device | features.get(device["name"], unknown) if device["kind"] == "host" else device
            for device in ask(self.monitor, "devices")
        ]

    def sessions(self) -> Any:
        return ask(self.quantum, "sessions")

    def paths(self) -> Any:
        return {"paths": ask(self.quantum, "paths"), "fibers": ask(self.quantum, "fibers")}

    def tapi(self) -> Any:
        paths = self.paths()
        return tapi.context(paths["paths"], paths["fibers"], self.sessions())

    def of_package(self, name: str) -> Any:
        """Return what the app of a package answers; raise Refused if there is none."""
        if name not in self.packages:
            raise Refused(f"no app answers {name!r}: install the package applications")
        return ask(self.packages[name], name)

    def set(self, device: str, settings: dict[str, int | None]) -> Any:
        """Override settings of a host, None leaves one to its applications again."""
        return ask(self.monitor, "set", device=device, settings=settings)

    def reload_policy(self) -> Any:
        """Read the policy file again; overrides become those of the file."""
        path = ask(self.quantum, "reload")
        ask(self.monitor, "reload")
        for app in self.packages.values():
            ask(app, "reload")
        return {"policy": path}


def check_settings_request(settings: object) -> dict[str, int | None]:
    """Return the numbers of settings decoded from JSON; raise Refused for anything else."""
    if not isinstance(settings, dict) or not settings:
        raise Refused('settings are an object such as {"rate_hz": 1000000}')
    try:
        return {name: setting_number(name, value) for name, value in settings.items()}
    except ValueError as error:
        raise Refused(f"{error}, or null to undo an override") from error


def perform(facts: Facts, request: object) -> Any:
    """Do what a request of the console asks for; raise Refused for anything else."""
    if not isinstance(request, dict):
        raise Refused('a request is an object such as {"command": "devices"}')
    fields = dict(request)
    command = fields.pop("command", None)
    commands: dict[str, tuple[set[str], Callable[..., Any]]] = {
        "devices": (set(), facts.devices),
        "sessions": (set(), facts.sessions),
        "paths": (set(), facts.paths),
        "set": ({"device", "settings"}, lambda device, settings: _set(facts, device, settings)),
        "reload-policy": (set(), facts.reload_policy),
        **{name: (set(), partial(facts.of_package, name)) for name in facts.packages},
    }
    if not isinstance(command, str) or command not in commands:
        raise Refused(f"no command {command!r}: {remedy(str(command), commands)}")
    names, call = commands[command]
    if set(fields) != names:
        expected = ", ".join(sorted(names)) or "nothing"
        raise Refused(f"{command} takes {expected}, not {', '.join(sorted(fields)) or 'nothing'}")
    return call(**fields)


def _set(facts: Facts, device: object, settings: object) -> Any:
    if not isinstance(device, str):
        raise Refused(f"device {device!r} is not a name")
    return facts.set(device, check_settings_request(settings))
