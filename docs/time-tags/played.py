"""The network of superdense coding, whose alice and bob play tags of a run.

qmn run qkd --protocol bbm92 --time stepped --topology docs/time-tags/played.py:Played
"""

from typing import Any

from applications.time_tags.played import play
from topologies.sdc import SdcTopo

FILES = {"alice": "tags/alice.tags", "bob": "tags/bob.tags"}


class Played(SdcTopo):
    """Slots of 50 ns; bob's clock is 123,456 ns ahead of alice's."""

    def build(self, **fiber: Any) -> None:
        super().build(**fiber)
        play(self, FILES, slot_ps=50_000, ahead_ps={"bob": 123_456_000})
