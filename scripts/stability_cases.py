"""All cases of the stability study by name."""

from __future__ import annotations

import stability_laws
import stability_rough
import stability_scenes
import stability_stepping
from stability_verdicts import Case


def _named(*groups: list[Case]) -> dict[str, Case]:
    found = {case.name: case for group in groups for case in group}
    assert len(found) == sum(map(len, groups)), "two cases of one name"
    return found


CASES: dict[str, Case] = _named(
    stability_laws.cases(), stability_stepping.cases(), stability_scenes.cases(), stability_rough.cases()
)
