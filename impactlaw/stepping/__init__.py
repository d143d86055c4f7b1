"""Ways to step a scene under an impact law, one folder each."""
