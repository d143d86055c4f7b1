"""Measure what a law costs or gains on tasks: policies made for one law act under others."""

from impactlaw.studies.run import run
from impactlaw.studies.study import Study, quick_study
from impactlaw.studies.transfer import TransferMatrix, transfer_matrices, transfer_matrix

__all__ = ["Study", "TransferMatrix", "quick_study", "run", "transfer_matrices", "transfer_matrix"]
