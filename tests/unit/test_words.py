"""Pages are short and begin with an example; the words of docs/ and of the product are plain."""

import pytest
from documentation import NAMES, ROOT

MOST_WORDS = 2500


@pytest.mark.parametrize("name", NAMES)
def test_a_page_has_at_most_2500_words(name: str) -> None:
    assert len((ROOT / name).read_text().split()) <= MOST_WORDS
