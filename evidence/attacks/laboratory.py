"""The attacks: what each tries, what stops it, and one trial of it without that and with it.

Each trial has a network of its own. Charlie acts as root on his host, and sees what a
host sees; what it comes to is counted elsewhere.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from evidence.attacks import bright_light, connections, floods, impostors, photons
from qmn.network.time_scale import PACED
from qmn.scripting import start
from topologies.networks.network import Network


@dataclass(frozen=True)
class Attack:
    """One attack on a network; `conduct` returns the count of one trial."""

    counted: str  # the meaning of the count
    defence: str  # the switch of the policy's [filter], or an option of the network
    conduct: Callable[[Network, int], int]
    attempts: int
    off: tuple[str, ...] = ()  # switches of [filter] that would be in its way in both trials
    is_option: bool = False

    def trial(self, defended: bool, attempts: int) -> tuple[int, int]:
        """Try it in a network of its own; return the count, and of how many."""
        with tempfile.TemporaryDirectory(prefix="qmn-attack-") as folder:
            policy = Path(folder) / "policy.toml"
            policy.write_text(self.policy(defended))
            options: dict[str, Any] = {self.defence: defended} if self.is_option else {}
            options["time"] = PACED  # charlie's programs go by the wall
            name = f"{self.conduct.__name__}-{self.defence}-{'on' if defended else 'off'}"
            with start("sdc", Path(folder) / name, policy=str(policy), **options) as network:
                return self.conduct(network, attempts), attempts

    def policy(self, defended: bool) -> str:
        switches = dict.fromkeys(self.off, False)
        if not self.is_option:
            switches[self.defence] = defended
        lines = (f"{name} = {str(on).lower()}\n" for name, on in switches.items())
        return f"[filter]\n{''.join(lines)}"


@dataclass(frozen=True)
class LightAttack:
    """One attack on light, between alice and bob of a physical layer without packets."""

    counted: str
    defence: str
    conduct: Callable[[bool, int], tuple[int, int]]  # whether defended, some bits; as `trial`
    attempts: int

    def trial(self, defended: bool, attempts: int) -> tuple[int, int]:
        """Try it; return the count, and of how many sifted bits."""
        return self.conduct(defended, attempts)


KNOWN = "sifted bits that eve knows, and that the key still reveals"

ATTACKS: dict[str, Attack | LightAttack] = {
    "arp-spoofing": Attack(
        "pings of bob to alice that reach charlie", "addresses", floods.arp_spoofing, 20
    ),
    "flow-table-flooding": Attack(
        "made-up stations that take an entry of s1's table",
        "addresses",
        floods.flow_table_flooding,
        500,
    ),
    "set-up-flooding": Attack(
        "set-ups without a connection that the controller decides",
        "handshakes",
        floods.set_up_flooding,
        200,
    ),
    "blind-rst": Attack(
        "sessions that the controller ends", "sequences", connections.blind_rst, 5, ("addresses",)
    ),
    "lldp-spoofing": Attack(
        "made-up fibres that the controller takes for bob's",
        "announcements",
        connections.lldp_spoofing,
        20,
    ),
    "replay": Attack(
        "repeated announcements that the controller believes",
        "announcements",
        connections.replay,
        20,
    ),
    "impostor-switch": Attack(
        "made-up switches that the controller programs",
        "tls",
        impostors.impostor_switch,
        5,
        is_option=True,
    ),
    "impostor-controller": Attack(
        "commands of another controller that q1 obeys",
        "tls",
        impostors.impostor_controller,
        20,
        is_option=True,
    ),
    "intercept-resend": LightAttack(KNOWN, "sample", photons.intercept_resend, 10_000),
    "fiber-tap": LightAttack(KNOWN, "sample", photons.fiber_tap, 10_000),
    "photon-splitting": LightAttack(KNOWN, "decoys", photons.photon_splitting, 10_000),
    "blinding": LightAttack(KNOWN, "monitor", bright_light.blinding, 10_000),
    "trojan-light": LightAttack(KNOWN, "isolator", bright_light.trojan_light, 10_000),
}
