"""Maps as packages and files have them, and the networks that are made of them."""

import json
import re
from importlib.resources import files
from itertools import combinations
from math import pi
from pathlib import Path
from typing import Any

import networkx
import pytest
from mininet.topo import Topo

from topologies.catalogue.map_parts import EARTH_KM, great_circle_km
from topologies.catalogue.maps import BadMap, positions, read_map
from topologies.links.copper_link import CopperLink
from topologies.links.fiber import FiberLink
from topologies.mapped import MapTopo
from wire.parameters.physics import BellAnalyser

MILE_KM = 1.609344  # the international mile
GRAPHML = """<graphml xmlns="http://graphml.graphdrawing.org/xmlns">
<key id="d0" for="node" attr.name="label" attr.type="string"/>
<key id="d1" for="node" attr.name="Longitude" attr.type="double"/>
<key id="d2" for="node" attr.name="Latitude" attr.type="double"/>
<key id="d3" for="edge" attr.name="dist" attr.type="double"/>
<graph edgedefault="undirected">
<node id="0"><data key="d0">Null Island</data><data key="d1">0</data><data key="d2">0</data></node>
<node id="1"><data key="d0">Q1</data><data key="d1">90</data><data key="d2">0</data></node>
<node id="2"><data key="d0">Zürich!</data></node>
<edge source="0" target="1"/>
<edge source="1" target="2"><data key="d3">7.5</data></edge>
</graph></graphml>"""
STAR = {
    "nodes": [{"name": name, "type": "QuantumRouter"} for name in ("center", "router1", "router2")],
    "qconnections": [
        {"node1": "center", "node2": name, "attenuation": 0.0002, "distance": 500, "type": "x"}
        for name in ("router1", "router2")
    ],
}


def graph_of(key: str) -> networkx.Graph:
    """Return networkx's reading of one of topohub's maps."""
    given = json.loads((files("topohub") / f"data/{key}.json").read_text())
    graph = networkx.node_link_graph(given, edges="edges")
    return networkx.relabel_nodes(graph, dict(graph.nodes(data="name")))


def fibers(topo: Topo) -> dict[str, list[dict[str, Any]]]:
    found: dict[str, list[dict[str, Any]]] = {}
    for one, other, info in topo.links(withInfo=True):
        if info.get("cls") is FiberLink:
            found.setdefault(f"{one} {other}", []).append(info)
    return found


@pytest.mark.parametrize("key", ["sndlib/abilene", "sndlib/nobel-germany"])
def test_a_known_map_is_as_topohub_reads_it(key: str) -> None:
    found, graph = read_map(key.partition("/")[2]), graph_of(key)
    called = {place.name: place.called for place in found.places}
    links = {
        frozenset((called[link.one], called[link.other])): link.length_km for link in found.links
    }
    assert links == {frozenset(ends): km for *ends, km in graph.edges(data="dist")}
    assert {place.called: list(place.position or ()) for place in found.places} == dict(
        graph.nodes(data="pos")
    )


def test_of_maps_of_several_years_the_newest_is_meant() -> None:
    garr = read_map("garr")
    assert garr.name == "topozoo/Garr201201"
    assert (len(garr.places), len(garr.links)) == (48, 62)  # as topohub's own list says
    names = [place.name for place in garr.places]
    assert len(set(names)) == 48
    assert all(len(f"{name}-eth0") < 16 for name in names)


def test_graphml_says_lengths_or_positions(tmp_path: Path) -> None:
    file = tmp_path / "own.graphml"
    file.write_text(GRAPHML)
    found = read_map(str(file))
    assert [place.name for place in found.places] == ["nullisland", "hq1", "zurich"]
    quarter, text = found.links  # of the equator
    assert quarter.length_km == pytest.approx(EARTH_KM * pi / 2)
    assert text.length_km == 7.5
    assert len(positions(found)) == 3
    nowhere = re.sub('<data key="d[123]">[0-9.]+</data>', "", GRAPHML)
    file.write_text(nowhere)
    with pytest.raises(BadMap, match=r"0 to 1 has no dist, in km, and no place .* has Longitude"):
        read_map(str(file))


def graphml_file(
    folder: Path, positions: dict[str, tuple[float, float] | None], *ends: str, kind: str = ""
) -> str:
    """Return a GraphML file of places, some without position, and edges as "a b"."""
    graph = (networkx.MultiDiGraph if kind == "directed" else networkx.MultiGraph)()
    for name, at in positions.items():
        known = {} if at is None else {"Longitude": at[0], "Latitude": at[1]}
        graph.add_node(name, label=name, **known)
    graph.add_edges_from(each.split() for each in ends)
    networkx.write_graphml(graph, folder / "own.graphml")
    return str(folder / "own.graphml")


def test_a_place_without_position_is_in_the_middle_of_its_neighbours(tmp_path: Path) -> None:
    degree_km = EARTH_KM * pi / 180
    places = {"west": (179.0, 0.0), "east": (-179.0, 0.0), "mid": None, "end": None}
    read = read_map(graphml_file(tmp_path, places, "west mid", "mid east", "mid end"))
    assert [link.length_km for link in read.links] == pytest.approx([degree_km, degree_km, 0.0])
    east, north = positions(read)["mid"]
    assert (abs(east), north) == pytest.approx((180.0, 0.0))


def test_a_fibre_that_a_directed_file_names_twice_is_one(tmp_path: Path) -> None:
    at: dict[str, tuple[float, float] | None] = {"aa": (0.0, 0.0), "bb": (1.0, 0.0)}
    ends = ("aa bb", "bb aa", "bb aa", "aa bb", "bb aa")
    both = read_map(graphml_file(tmp_path, at, *ends, kind="directed"))
    assert len(both.links) == 3  # as many as the direction that is named more often
    assert len(read_map(graphml_file(tmp_path, at, *ends)).links) == 5


@pytest.mark.parametrize("name", ["東京", " 東京", "Zu\u0308rich", "ZÜRICH"])
def test_a_place_is_found_by_its_name_in_any_script(tmp_path: Path, name: str) -> None:
    at: dict[str, tuple[float, float] | None] = {"東京": (139.7, 35.7), "Zürich": (8.5, 47.4)}
    read = read_map(graphml_file(tmp_path, at, "東京 Zürich"))
    assert read.place(name).name == ("h" if "東京" in name else "zurich")


def test_a_great_circle_is_that_of_published_places() -> None:
    """Nashville to Los Angeles, the usual example of the formula: 2886.4 km on a mean sphere."""
    assert great_circle_km((-86.67, 36.12), (-118.40, 33.94)) == pytest.approx(2886.4, abs=0.5)


def test_graphml_s_towns_are_as_far_apart_as_is_published(tmp_path: Path) -> None:
    """geopy's manual has Newport, Rhode Island, 536.997990696 miles from Cleveland, Ohio."""
    at: dict[str, tuple[float, float] | None] = {"newport": (-71.312796, 41.49008)}
    at["cleveland"] = -81.695391, 41.499498
    (link,) = read_map(graphml_file(tmp_path, at, "newport cleveland")).links
    assert link.length_km == pytest.approx(536.997990696 * MILE_KM, rel=1e-6)


def test_topohub_s_towns_are_north_and_east_of_greenwich_as_an_atlas_has_them() -> None:
    """Berlin is at 52.52 N 13.41 E, Munich at 48.14 N 11.58 E: 504 km apart as the crow flies."""
    places = {place.called: place.position for place in read_map("nobel-germany").places}
    berlin, munich = places["Berlin"], places["Muenchen"]
    assert berlin == pytest.approx((13.41, 52.52), abs=0.1)
    assert munich == pytest.approx((11.58, 48.14), abs=0.1)
    assert berlin
    assert munich
    assert great_circle_km(berlin, munich) == pytest.approx(504, rel=0.01)


def test_sequence_s_metres_are_kilometres_here(tmp_path: Path) -> None:
    file = tmp_path / "star.json"
    file.write_text(json.dumps(STAR))
    found = read_map(str(file))
    assert [(link.one, link.other) for link in found.links] == [
        ("center", "router1"),
        ("center", "router2"),
    ]
    assert {(link.length_km, link.loss_db_per_km) for link in found.links} == {(0.5, 0.2)}
    laid = fibers(MapTopo(map=str(file)))["q1 q2"][0]
    assert (laid["length_km"], laid["loss_db_per_km"]) == (0.5, 0.2)
    laid = fibers(MapTopo(map=str(file), loss_db_per_km=0.4))["q1 q2"][0]
    assert laid["loss_db_per_km"] == 0.4
    channels = [
        {"source": a, "destination": b, "distance": 800, "attenuation": 0}
        for a, b in [("center", "router1"), ("router1", "center"), ("router1", "router2")]
    ]
    file.write_text(json.dumps({"nodes": STAR["nodes"], "qchannels": channels}))
    assert [link.length_km for link in read_map(str(file)).links] == [0.8, 0.8]
    file.write_text(json.dumps({**STAR, "qchannels": channels, "stop_time": 1, "templates": {}}))
    both = read_map(str(file))
    assert [link.length_km for link in both.links] == [0.5, 0.5, 0.8, 0.8]
    assert both.unused == ("nodes.type", "qconnections.type", "stop_time", "templates")


@pytest.mark.parametrize(
    "content",
    [b"hello", b"<graphml", b"\xff\xfe", b"", b"<a/>", b"<a>" * 100_000, GRAPHML[:-9].encode()],
)
def test_a_file_that_is_no_graphml_is_one_line_with_its_name(
    tmp_path: Path, content: bytes
) -> None:
    file = tmp_path / "bad.graphml"
    file.write_bytes(content)
    with pytest.raises(BadMap) as caught:
        read_map(str(file))
    assert str(caught.value).startswith(str(file)) or content == b"<a/>"
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ("[" * 200_000, "bad.json is not a map: it is nested too deeply"),
        ("{", "bad.json is not a map of its kind: JSONDecodeError"),
        (
            '{"nodes": [{"name": "a"}], "qchannels": [{"source": "a", "destination": "a"}]}',
            "bad.json: a way from a to a: join two different nodes",
        ),
        (
            '{"nodes": [{"name": "a"}, {"name": "b"}], "qchannels": [{"source": "a",'
            ' "destination": "b", "distance": 1e999, "attenuation": 0}]}',
            "map bad: a way from a to b of inf km",
        ),
        ("{}", "is not a map of its kind: KeyError 'nodes'"),
        ("[]", "is not a map of its kind"),
        ('{"nodes": []}', "has no places"),
        ('{"nodes": [{"name": "a"}, {"name": "b"}]}', "no way from ha to hb|no way from a to b"),
        (
            '{"nodes": [], "qconnections": [{"node1": "a", "node2": "b", "distance": 1,'
            ' "attenuation": 0}]}',
            "a way from a to b, and not both are places",
        ),
    ],
)
def test_a_file_that_is_no_map_is_refused(tmp_path: Path, content: str, text: str) -> None:
    (tmp_path / "bad.json").write_text(content)
    with pytest.raises(BadMap, match=text):
        read_map(str(tmp_path / "bad.json"))


def test_maps_and_places_that_are_not_there_are_refused_with_those_that_are(tmp_path: Path) -> None:
    for name in ("abilen", "../abilene", "sndlib/../sndlib/abilene", ""):
        with pytest.raises(
            BadMap, match=r"there is no map .*: choose one of topohub's, such as abilene"
        ):
            read_map(name)
    with pytest.raises(BadMap, match="such as abilene, nobel-germany, garr, or"):  # nothing is near
        read_map("nowhere")
    with pytest.raises(BadMap, match=r"cannot read the map .*none\.json: No such file"):
        read_map(str(tmp_path / "none.json"))
    with pytest.raises(
        BadMap, match="sndlib/abilene has no place 'rome': choose one of atlam5, atlang"
    ):
        MapTopo(hosts_at="rome")
    with pytest.raises(ValueError, match="the map says how long fibres are"):
        MapTopo(length_km=3.0)


def test_each_place_has_a_switch_and_a_host_and_the_centre_the_source() -> None:
    topo, graph = MapTopo(map="abilene"), graph_of("sndlib/abilene")
    laid = fibers(topo)
    assert len([name for name in topo.switches() if name != "s1"]) == graph.number_of_nodes()
    between = {name: infos for name, infos in laid.items() if name.startswith("q")}
    joined = [name for name in between if all(each.startswith("q") for each in name.split())]
    assert len(joined) == graph.number_of_edges()
    assert all(len(infos) == 2 for infos in laid.values())
    center = min(networkx.center(graph, e=networkx.eccentricity(graph, weight="dist")))
    assert center == "KSCYng"
    at_source = topo.linkInfo("src", "q7")  # Kansas City is the seventh place
    assert at_source["cls"] is FiberLink
    assert topo.nodeInfo("sttlng")["pairs_from"] == "src"


def test_copper_is_never_shorter_than_the_ways_of_the_map() -> None:
    topo, graph = MapTopo(map="nobel-germany"), graph_of("sndlib/nobel-germany")
    copper = {
        one: info["length_km"]
        for one, other, info in (
            (*sorted(ends, key="s1".__eq__), info)
            for *ends, info in topo.links(withInfo=True)
            if info["cls"] is CopperLink
        )
    }
    hosts = {place.called: place.name for place in read_map("nobel-germany").places}
    away = dict(networkx.all_pairs_dijkstra_path_length(graph, weight="dist"))
    for one, other in combinations(graph, 2):
        by_copper = copper[hosts[one]] + copper[hosts[other]]
        assert by_copper >= away[one][other] - 1e-9


def test_hosts_and_sources_are_where_they_are_wanted() -> None:
    topo = MapTopo(
        map="abilene",
        hosts_at="STTLng,losang,nycmng",
        sources_at="snvang,washng",
    )
    assert set(topo.hosts()) == {"ed", "src1", "src2", "sttlng", "losang", "nycmng"}
    sources = {host: topo.nodeInfo(host)["pairs_from"] for host in ("sttlng", "losang", "nycmng")}
    assert sources == {"sttlng": "src1", "losang": "src1", "nycmng": "src2"}


def test_halves_that_come_long_before_the_others_are_kept_unless_an_analyser_is_named() -> None:
    """Ways of two halves over a map differ by more than the usual 2,000 km, of .2 dB each."""
    usual = MapTopo().nodeInfo("sttlng")["device"]
    assert usual.analyser == BellAnalyser(delay_line_db_per_km=0.0, delay_line_km=20_000.0)
    usual.check("sttlng")
