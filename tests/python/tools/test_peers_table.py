"""The README's comparison with other simulators: every cell has a source."""

import copy

import pytest
from messages import refused
from ruamel.yaml import YAML

from tools import peers_table

CONTENT = {
    "peers": {"Peer": {"documentation": "https://peer.org"}},
    "rows": {"LiDAR": {"flockstep": "yes", "Peer": ["partly", "Peer 1.2.0"]}, "wind": {"flockstep": "yes"}},
}


def test_a_cell_without_text_is_a_dash():
    assert peers_table.table(CONTENT).splitlines()[2:] == ["| LiDAR | yes | partly |", "| wind | yes | \N{EN DASH} |"]


@pytest.mark.parametrize("cell", [["partly"], ["partly", "everybody knows"], ["partly", "https://peer.org", "Peer"]])
def test_a_cell_without_a_source_is_refused(cell):
    content = copy.deepcopy(CONTENT)
    content["rows"]["LiDAR"]["Peer"] = cell
    with refused(SystemExit, "LiDAR, Peer"):
        peers_table.table(content)


def test_the_table_compares_with_the_peers_of_the_field():
    content = YAML(typ="safe").load(peers_table.PEERS)
    assert {"hyperdrone", "DiffAero", "Aerial Gym"} < set(content["peers"])
    assert content["rows"]["policy onto hardware"]["Aerial Gym"][0] == "PX4 module, ROS node"
