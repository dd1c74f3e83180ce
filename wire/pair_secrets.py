"""The secrets that two hosts each share: files in a private folder, one for two hosts.

Which of the two first needs it draws it: so what there is grows with the pairs that use it.
"""

import os
import secrets
from contextlib import suppress
from pathlib import Path

SECRET_BYTES = 32


def secret_file(folder: Path, one: str, other: str) -> Path:
    """Return the file of a secret, in hex, which is there from now on."""
    file = folder / ":".join(sorted((one, other)))
    if not file.exists():
        drawn = file.with_name(f".{file.name}-{os.getpid()}")
        drawn.touch(mode=0o600)
        drawn.write_text(secrets.token_hex(SECRET_BYTES))
        with suppress(FileExistsError):  # the other has drawn it meanwhile
            os.link(drawn, file)
        drawn.unlink()
    return file
