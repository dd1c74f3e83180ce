"""The configuration of one end of a VPN whose keys come from a key manager."""

from dataclasses import dataclass

from wire.config import Config
from wire.key_delivery import KEY_DELIVERY_PORT

AGREEMENT_PORT = 9414  # where the end that follows hears the ids of keys


@dataclass(frozen=True)
class VpnConfig(Config):
    """A tunnel's end, the other end, and who the host's key manager takes this program for."""

    interface: str
    leads: bool  # whether it is this end that asks for new keys
    private_key: str  # of the tunnel's protocol; base64
    peer: str  # public key of the other end; base64
    address: str  # of this host, where its key manager is, too
    other: str  # of the other host
    inside: str  # this end's address in the tunnel, with prefix length
    other_inside: str
    other_sae: str  # SAE ID of the other end
    certificate: str  # paths of PEM files
    key_file: str
    authority: str
    rotate_s: float  # a new key so often
    lifetime_s: float  # no key is used for longer
    port: int = KEY_DELIVERY_PORT
