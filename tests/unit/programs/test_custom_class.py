"""Classes of a user's own: what is loaded, and what is refused by file and name."""

from pathlib import Path

import pytest

from programs.custom_class import load_class
from wire.config import BadConfig

SOURCE = """
class Good:
    def effect(self):
        return 7

class Other:
    pass

number = 3
"""


def has_effect(kind: type) -> bool:
    return hasattr(kind, "effect")


def test_a_class_is_loaded_from_its_file(tmp_path: Path) -> None:
    file = tmp_path / "own.py"
    file.write_text(SOURCE)
    assert load_class("noise", f"{file}:Good", "with an effect", has_effect)().effect() == 7
    assert load_class("noise", f"{file}:Other").__name__ == "Other"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("nowhere.py:Good", "noise .*nowhere.py:Good: there is no file .*; write FILE.py:CLASS"),
        ("own.py:Other", "own.py has no class Other with an effect"),
        ("own.py:number", "own.py has no class number with an effect"),
        ("own.py:", "own.py has no class  with an effect"),
        ("own.txt:Good", "own.txt is not a Python file"),
        ("broken.py:Good", "broken.py cannot be loaded: No module named 'nowhere'"),
        ("half.py:Good", "half.py cannot be loaded: "),
    ],
)
def test_what_is_no_such_class_is_refused(tmp_path: Path, name: str, text: str) -> None:
    for file in ("own.py", "own.txt"):
        (tmp_path / file).write_text(SOURCE)
    (tmp_path / "broken.py").write_text("import nowhere\n")
    (tmp_path / "half.py").write_text("class Good(\n")
    with pytest.raises(BadConfig, match=text):
        load_class("noise", f"{tmp_path}/{name}", "with an effect", has_effect)
