"""Record runs: `Recorder` writes a rerun file, `read_log` reads it back. No other package depends on rerun."""

from impactlaw.recording.episodes import Episode, LawChange
from impactlaw.recording.reader import Recording, WorstViolation, read_log
from impactlaw.recording.recorder import Recorder
from impactlaw.recording.report import describe

__all__ = ["Episode", "LawChange", "Recorder", "Recording", "WorstViolation", "describe", "read_log"]
