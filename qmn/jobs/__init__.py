"""Jobs: what qmn run starts on a network and follows to its end."""
