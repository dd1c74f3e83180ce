"""Interception: attacks of a host on the light of others that goes by way of it."""
