"""The ends of graph states: a line of hosts."""

from applications.ghz.connections import line
from applications.graph_states.options import GraphOptions
from applications.graph_states.protocol import Follower, Leader
from wire.metadata.vocabulary import Service

KIND = line(Service["GRAPH"], GraphOptions, Leader, Follower)
