"""Nodes whose shell has ended, where Mininet alone would wait for ever."""

from mininet.node import Node

from topologies.nodes import ShellWatcher


class Watched(ShellWatcher, Node):
    """A node of no special kind."""


def test_a_command_in_whose_middle_the_shell_ends_returns() -> None:
    node = Watched("watched", inNamespace=False)
    assert node.cmd("echo here").strip() == "here"
    assert not node.shell_ended
    node.cmd("kill -KILL $$")
    assert node.shell_ended
    assert node.cmd("echo too late") == ""
    node.terminate()
