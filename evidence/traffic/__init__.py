"""Heavy traffic: sessions of many hosts, planned by a model, driven, and counted."""
