"""Thousands of worlds of one scene under impact laws, in MuJoCo's own threads."""

from impactlaw.compiled import compile_together

compile_together("impactlaw.stepping.time_stepping.compiled.entry")

from impactlaw.batch.batch import Batch  # noqa: E402  its module compiles what it imports

__all__ = ["Batch"]
