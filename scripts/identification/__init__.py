"""Two results of identification: which law measured drops of an ellipse obey, and which one chains of springs."""
