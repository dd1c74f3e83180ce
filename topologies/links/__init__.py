"""Fibres and copper between Mininet nodes: what they are made of, how long, and how fast."""

from topologies.links.copper_link import CopperLink
from topologies.links.fiber import FiberLink

__all__ = ["CopperLink", "FiberLink"]
