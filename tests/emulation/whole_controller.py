"""The controller with its framework loaded, but not begun: it is forked off as it is."""

from controller_apps.__main__ import main as begin
from controller_apps.openflow import framework


def main() -> int:
    """Run it; to load Ryu makes an eventlet hub, whose files no fork has: it gets a new one."""
    if framework.NAME == "ryu":
        framework.hub.eventlet.hubs.use_hub()
    return begin()
