"""Laws whose outcomes are drawn."""
