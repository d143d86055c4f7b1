"""Held contacts on a rim that a correction of position has moved further than their bodies."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from impactlaw.stepping.event_driven.matching import refound

KEY, OTHER = 7, 8
"""Two pairs of geoms."""


def found(known, held, keys, places, rolling):
    """Return the indices for contacts at the end of a phase, which began with contacts of KEY at x = 0 and 1 m."""
    pattern: Any = SimpleNamespace(key=np.array(keys), rolling=np.array(rolling))
    positions = np.array([[x, 0.0, 0.0] for x in places])
    contacts: Any = SimpleNamespace(pattern=pattern, contacts=SimpleNamespace(position=positions))
    places_then = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    then = SimpleNamespace(position=places_then)
    start = SimpleNamespace(pattern=SimpleNamespace(key=np.array([KEY, KEY])), contacts=then)
    phase: Any = SimpleNamespace(start=start)
    return refound(np.array(known), np.array(held), contacts, phase).tolist()


def test_a_held_contact_is_the_nearest_new_one_on_the_rim():
    assert found([-1, -1], [1], [KEY, KEY], [0.2, 0.7], [True, True]) == [-1, 1]
    assert found([-1, -1], [0, 1], [KEY, KEY], [0.7, 0.2], [True, True]) == [1, 0]


def test_a_contact_that_continues_another_one_or_is_of_other_geoms_or_on_no_rim_is_not_taken():
    assert found([0, -1], [0, 1], [KEY, KEY], [0.9, 0.2], [True, True]) == [0, 1]
    assert found([-1], [1], [OTHER], [1.0], [True]) == [-1]
    assert found([-1], [1], [KEY], [1.0], [False]) == [-1]


def test_what_is_not_missing_stays():
    assert found([0, 1, -1], [0, 1], [KEY] * 3, [0.0, 1.0, 1.0], [True] * 3) == [0, 1, -1]
    assert found([-1], [-1], [KEY], [0.0], [True]) == [-1]
