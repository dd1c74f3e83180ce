"""OpenFlow 1.4 as bytes: the messages that the agent reads, changes or writes itself.

Everything else passes through the agent unread. Constants carry the names of the
specification (from os_ken); os_ken's own parsers take whatever they are given and some of
them loop or fail on hostile bytes, so what counts is taken apart here, and whole or not at
all: anything malformed raises MalformedPacket.
"""
