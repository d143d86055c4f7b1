"""Gymnasium environments in which the impact law decides, registered on import."""
