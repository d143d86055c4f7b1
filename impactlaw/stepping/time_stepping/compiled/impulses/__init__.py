"""The contact problem of a compiled step: solved once, collisions one after another, and the working set."""
