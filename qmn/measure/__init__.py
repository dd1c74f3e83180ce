"""What `qmn bench` measures, each beside the floor that the same machine sets."""
