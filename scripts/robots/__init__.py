"""The study "robots": rigid contact on robots and scenes from outside this project."""
