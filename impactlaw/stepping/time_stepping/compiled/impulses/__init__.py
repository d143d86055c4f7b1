"""What contact does in a compiled step: one problem, collisions one after another, and looks at what is near."""
