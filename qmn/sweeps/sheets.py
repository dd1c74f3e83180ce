"""The sheets that `make curves` draws, in this order."""

from qmn.sweeps.device_sheets import DEVICE_SHEETS
from qmn.sweeps.key_sheets import KEY_SHEETS
from qmn.sweeps.link_sheets import LINK_SHEETS
from qmn.sweeps.network_sheets import NETWORK_SHEETS
from qmn.sweeps.pair_sheets import PAIR_SHEETS

SHEETS = (*PAIR_SHEETS, *DEVICE_SHEETS, *KEY_SHEETS, *LINK_SHEETS, *NETWORK_SHEETS)
