"""What a step leaves for the next one: contacts that need not be looked at again, and a possible shortcut."""

from __future__ import annotations

import numpy as np

from impactlaw.stepping.event_driven.contact_state import ContactState
from impactlaw.stepping.event_driven.shortcuts import Apart, Shortcut, find_rest, find_together, is_still
from impactlaw.stepping.event_driven.smooth_phase import SmoothPhases
from impactlaw.stepping.plan import Plan


class LastStep:
    """The end of the last step; empty before the first step."""

    def __init__(self, phases: SmoothPhases, plan: Plan):
        self._phases, self._plan = phases, plan
        self._left: tuple[bytes, int, bytes, float, bytes] | None = None  # see `_now`
        self._contacts: ContactState | None = None
        self._shortcut: Shortcut | None = None

    def end(self, state: np.ndarray, contacts: ContactState, *, collided: bool) -> None:
        """Store the current contacts, at the end of a step that began in a saved state."""
        self._left, self._contacts = self._now(), contacts
        self._shortcut = self._find_shortcut(state, contacts, collided)

    def end_otherwise(self) -> None:
        """Store the current configuration, which another way to step has reached."""
        self._left, self._contacts, self._shortcut = self._now(), None, None

    def forget(self) -> None:
        """Make the next step look at its contacts."""
        self._contacts = self._shortcut = None

    def contacts(self) -> ContactState | None:
        """Return the current contacts if nothing has changed since the last step, else None."""
        surfaces = self._phases.surfaces
        goes_on = surfaces is None or surfaces.goes_on
        return self._contacts if goes_on and self._left == self._now() else None

    def is_here(self) -> bool:
        """Return whether the configuration is that at the end of the last step, so that the same contacts are near."""
        now, left = self._phases.configuration.data.qpos.tobytes(), self._left
        return left is not None and left[0] == now and left[1] == self._phases.options.disabled

    def take_shortcut(self, state: np.ndarray) -> bool:
        """Take a step from the current state, which is saved, by the shortcut that was found; return whether it lasts.

        Velocities may have been changed meanwhile: the shortcut is judged by those at the end. If it does not last, the
        state is restored.
        """
        shortcut, self._shortcut = self._shortcut, None
        if shortcut is None or not self.is_here():
            return False
        self._shortcut = shortcut.lasts(self._phases)
        if self._shortcut is None:
            self._phases.configuration.restore(state)
            return False
        if self._phases.surfaces is not None:
            self._phases.surfaces.end_there(self._phases.configuration.data)
        self._contacts, self._left = None, self._now()
        return True

    def _find_shortcut(self, state: np.ndarray, contacts: ContactState, collided: bool) -> Shortcut | None:
        """Return a shortcut that the next step may try, given how this step ended."""
        if not len(contacts.gap):
            return Apart(self._phases.frames())
        if collided or not self._plan.rest:
            return None
        if not is_still(self._phases, contacts.velocity, contacts.still):
            return find_together(self._phases, contacts)
        return find_rest(self._phases, state, contacts)

    def _now(self) -> tuple[bytes, int, bytes, float, bytes]:
        """Return what contacts depend on: qpos, flags of the options, qvel, timestep, s, and active equalities."""
        data, options = self._phases.configuration.data, self._phases.options
        equalities = data.eq_active.tobytes() if self._plan.bilateral else b""
        return data.qpos.tobytes(), options.disabled, data.qvel.tobytes(), options.timestep, equalities
