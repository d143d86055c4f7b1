"""A new impact law in one file: it keeps a chosen share of the kinetic energy, where the contacts allow it.

One sees that a law is a frozen dataclass with one method; certificate, audit and steppers work without more code. The
law is Moreau's, with e from ``T+ = T_p + e^2 (T- - T_p)``, where T_p is the energy after maximal dissipation.
"""

from dataclasses import dataclass

import numpy as np

from impactlaw import Collision, Law, MaximalDissipation, Stepper
from impactlaw.laws.base import Target
from impactlaw.models import load


@dataclass(frozen=True)
class KeepEnergy(Law):
    """Moreau's law with the coefficient that keeps a share of the kinetic energy."""

    share: float

    def target(self, collision: Collision) -> Target:
        """Return ``-e gamma-`` with the e that keeps the share."""
        lost = -MaximalDissipation().resolve(collision).energy_change
        square = 1.0 - (1.0 - self.share) * collision.kinetic_energy / lost if lost > 0.0 else 0.0
        e = float(np.sqrt(np.clip(square, 0.0, 1.0)))
        return Target(-e * collision.pre_contact_velocity, coefficient=e)


for share in (1.0, 0.8, 0.5, 0.1):
    model, data = load("ball_chain")
    stepper = Stepper(model, KeepEnergy(share))
    stepper.step(data)
    impact = stepper.events[0].impact
    kept = 1.0 + impact.energy_change / impact.collision.kinetic_energy
    after = impact.post_velocity.round(4) + 0.0
    print(f"asked for {share:.1f}, kept {kept:.4f}: v+ = {after}, residual {impact.residual:.0e}")
