"""What compiled steps know of a world: where its arrays are, what it remembers, how a step has ended."""
