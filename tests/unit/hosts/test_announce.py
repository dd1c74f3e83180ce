"""LLDP announcements as another implementation reads them."""

from scapy.contrib.lldp import (
    LLDPDUChassisID,
    LLDPDUGenericOrganisationSpecific,
    LLDPDUManagementAddress,
    LLDPDUPortID,
)
from scapy.layers.l2 import Ether

from hosts.hardware.announce import announcement
from wire.features import EMIT, STORE, Abilities


def test_an_announcement_says_who_where_and_what_it_can_do() -> None:
    mac = "02:00:00:00:01:00"
    frame = Ether(announcement("alice", "alice-q0", "10.0.0.1", mac, Abilities(EMIT | STORE, 32)))
    assert (frame.src, frame.type) == (mac, 0x88CC)
    assert (frame[LLDPDUChassisID].id, frame[LLDPDUPortID].id) == (b"alice", b"alice-q0")
    assert frame[LLDPDUManagementAddress].management_address == bytes([10, 0, 0, 1])
    ours = frame[LLDPDUGenericOrganisationSpecific]
    assert (ours.org_code, ours.subtype, ours.data.hex()) == (0x02514D, 2, "0300000020")
