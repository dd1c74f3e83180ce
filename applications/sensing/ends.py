"""The ends of distributed sensing: a line of hosts."""

from applications.ghz.connections import line
from applications.sensing.protocol import Follower, Leader, SensingOptions
from wire.metadata.vocabulary import Service

KIND = line(Service["SENSE"], SensingOptions, Leader, Follower)
