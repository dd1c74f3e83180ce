"""The sheets that `make curves` draws, in this order."""

from evidence.curves.device_sheets import DEVICE_SHEETS
from evidence.curves.key_sheets import KEY_SHEETS
from evidence.curves.link_sheets import LINK_SHEETS
from evidence.curves.network_sheets import NETWORK_SHEETS
from evidence.curves.pair_sheets import PAIR_SHEETS

SHEETS = (*PAIR_SHEETS, *DEVICE_SHEETS, *KEY_SHEETS, *LINK_SHEETS, *NETWORK_SHEETS)
