"""The ends of distributed sensing: a line of hosts."""

from applications.sensing.protocol import Follower, Leader, SensingOptions
from hosts.middleware.services.ghz.connections import line
from wire.metadata.vocabulary import Service

KIND = line(Service["SENSE"], SensingOptions, Leader, Follower)
