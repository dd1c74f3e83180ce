"""A gate with a bug: it leaps while programs work (tests/emulation/test_wrong_leaps.py)."""

import sys
from unittest.mock import patch

from gate.__main__ import main
from gate.quiescence import Quiescence

if __name__ == "__main__":
    with patch.object(Quiescence, "__bool__", lambda _self: True):
        sys.exit(main())
