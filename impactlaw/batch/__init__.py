"""Step thousands of worlds of one scene under impact laws, in MuJoCo's own threads."""

from impactlaw.batch.batch import Batch

__all__ = ["Batch"]
