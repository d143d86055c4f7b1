"""The study "robots": rigid contact on robots and scenes that nobody in this project wrote."""
