"""All cases of the stability study by name."""

from . import laws, rough, scenes, stepping
from .verdicts import Case

_ALL = (*laws.cases(), *stepping.cases(), *scenes.cases(), *rough.cases())
CASES: dict[str, Case] = {case.name: case for case in _ALL}
assert len(CASES) == len(_ALL), "two cases of one name"
