"""The controller: MAC learning and quantum metadata, on Ryu or on os-ken."""
