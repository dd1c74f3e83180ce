"""The agent's names of OpenFlow 1.4 against os-ken's, an independent list of them."""

from os_ken.ofproto import ofproto_v1_4

from qswitch_agent.openflow import constants


def test_names_mean_what_they_mean_to_os_ken() -> None:
    names = [name for name in vars(constants) if name.startswith("OFP")]
    assert len(names) > 100
    ours = {name: getattr(constants, name) for name in names}
    assert ours == {name: getattr(ofproto_v1_4, name) for name in names}
