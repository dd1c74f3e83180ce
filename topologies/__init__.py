"""Mininet nodes, fibre links and topologies, and what starts and ends them."""

import logging

import mininet.log  # noqa: F401

# From here on Mininet would make all loggers its own, which stay silent: those of
# the programs, too, that are forked off this process.
logging.setLoggerClass(logging.Logger)
