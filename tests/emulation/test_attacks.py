"""What attacks come to with their defence off, and with it on."""

from pathlib import Path

import pytest
from conftest import verb
from fabric_scene import running

from qmn.attacks.laboratory import ATTACKS
from topologies.sdc import SdcTopo

ATTEMPTS = {"arp-spoofing": 10, "flow-table-flooding": 60, "set-up-flooding": 40}


@pytest.mark.parametrize("defended", [False, True])
def test_attacks_succeed_without_their_defence_alone(tmp_path: Path, defended: bool) -> None:
    """Undefended each attempt succeeds, as ARP, learning switches and TCP have it (RFC 826, 793).

    A frame may be lost on its way to the controller, or bob may hear alice herself once.
    """
    assert ATTEMPTS.keys() == ATTACKS.keys()
    policy = tmp_path / "policy.toml"
    words = "true" if defended else "false"
    policy.write_text(f"[filter]\naddresses = {words}\nhandshakes = {words}\n")
    with running(SdcTopo, tmp_path, policy=str(policy)) as network:
        for name, attempts in ATTEMPTS.items():
            reached = ATTACKS[name].conduct(network, attempts)
            assert reached == 0 if defended else 0.8 * attempts <= reached <= attempts, name


def test_the_verb_prints_the_count() -> None:
    said = verb("attack", "set-up-flooding", "--attempts", "5", "--defence", "on").stdout
    assert "set-up-flooding" in said
    assert "handshakes on" in said
    assert "0 of 5 set-ups" in said
