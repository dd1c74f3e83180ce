"""Packets that the switches hand to the controller: TCP segments and UDP datagrams."""
