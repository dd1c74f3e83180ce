"""A package that extends qmn by entry points: docs/adding-a-service.md."""

from pathlib import Path

VILLAGE = Path(__file__).with_name("village.json")  # a map, as --topology map,village
LIFO = Path(__file__).with_name("lifo.toml")  # a policy, as --policy lifo
