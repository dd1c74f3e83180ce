"""Layouts of the messages, and what scapy and Wireshark read them with."""
