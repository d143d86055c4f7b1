"""Two results of identification: the laws that measured drops of an ellipse and chains of elastic balls obey."""
