"""Entanglement distribution between whole stacks over loopback, with a real dispatcher."""

from pathlib import Path

from stacks_scene import ask


def test_pairs(tmp_path: Path) -> None:
    alice, bob = ask(tmp_path, "distribute", count=1000)
    print(alice, bob)
    assert alice["pairs"] == 1000
