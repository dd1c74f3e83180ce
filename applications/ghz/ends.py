"""The ends of GHZ states: a line of hosts."""

from applications.ghz.connections import line
from applications.ghz.options import GhzOptions
from applications.ghz.protocol import Follower, Leader
from wire.metadata.vocabulary import Service

KIND = line(Service["GHZ"], GhzOptions, Leader, Follower)
