"""OpenFlow 1.4 messages: made for switches, and read from them."""
