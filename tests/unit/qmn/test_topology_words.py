"""The topology of the command line, as Mininet spells it: NAME,VALUE,PARAMETER=VALUE."""

import argparse

import pytest

from qmn.network.topologies import topology


@pytest.mark.parametrize(
    ("text", "options"),
    [
        ("sdc", {}),
        ("sdc,both_ways", {"both_ways": True}),
        ("chain,5", {"switches": 5}),
        ("chain,5,1", {"switches": 5, "fibers": 1}),
        ("chain,switches=5,both_ways=false", {"switches": 5, "both_ways": False}),
        ("ring,4,both_ways,fibers=3", {"switches": 4, "both_ways": True, "fibers": 3}),
        ("leaf-spine,4,3", {"leaves": 4, "spines": 3}),
        ("repeaters,3", {"repeaters": 3}),
        ("tree,hosts=16,switches=5", {"hosts": 16, "switches": 5}),
        ("map,garr", {"map": "garr"}),
        (
            "map,garr,hosts_at=rm1,mi1,sources_at=na,fibers=1",
            {"map": "garr", "hosts_at": "rm1,mi1", "sources_at": "na", "fibers": 1},
        ),
        ("my.py:Net,switches=3", {"switches": 3}),
    ],
)
def test_values_go_to_parameters(text: str, options: dict[str, object]) -> None:
    assert topology(text) == {"topology": text.partition(",")[0], **options}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("torus", "'torus': choose one of sdc, chain"),
        ("chian,3", "'chian': did you mean chain?"),
        ("chain,many", "switches 'many': choose a whole number"),
        ("tree,9,2,7", "tree has no parameter '7': choose one of hosts, switches"),
        ("chain,3,switches=4", "chain: switches is 3 and 4: name it once"),
        ("chain,swiches=3", "chain has no parameter 'swiches': did you mean switches?"),
        ("ring,spines=2", "spines is of leaf-spine, not of ring: leave it out"),
        ("sdc,switches=2", "switches is of chain, ring, tree, not of sdc: leave it out"),
        ("sdc,hosts_at=rome", "hosts_at is of map, not of sdc: leave it out"),
        ("map,garr,repeaters_at=rome", "repeaters_at is gone: quantum switches swap, not hosts"),
        ("repeaters,stations", "stations is gone: quantum switches swap, not hosts"),
        ("ring,both_ways=perhaps", "both_ways 'perhaps': choose true or false"),
        ("my.py:Net,switchs=3", "my.py:Net has no parameter 'switchs': did you mean switches?"),
    ],
)
def test_what_cannot_be_is_refused(text: str, words: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError) as caught:
        topology(text)
    assert words in str(caught.value)
