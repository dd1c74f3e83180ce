"""The quantum hardware of hosts: sources, memories, detectors, Bell analysers."""
