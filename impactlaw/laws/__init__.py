"""The impact laws, one file each."""

from impactlaw.laws.base import Law, RestitutionLaw, Target, energy_gain
from impactlaw.laws.compliant import Compliant
from impactlaw.laws.drawn.any_outcome import AnyOutcome
from impactlaw.laws.fremond import Fremond, Reversal
from impactlaw.laws.friction.coulomb import Coulomb
from impactlaw.laws.friction.routh import Routh
from impactlaw.laws.linear_map import LinearMap
from impactlaw.laws.maximal_dissipation import MaximalDissipation
from impactlaw.laws.moreau import Moreau
from impactlaw.laws.newton import Newton
from impactlaw.laws.poisson import Poisson
from impactlaw.laws.registry import DESCRIPTIONS, LAWS, make_law, takes_restitution
from impactlaw.laws.restitution.portable import portable, restored
from impactlaw.laws.scattered import Scattered

__all__ = [
    "DESCRIPTIONS", "LAWS", "AnyOutcome", "Compliant", "Coulomb", "Fremond", "Law", "LinearMap", "MaximalDissipation",
    "Moreau", "Newton", "Poisson", "RestitutionLaw", "Reversal", "Routh", "Scattered", "Target", "energy_gain",
    "make_law", "portable", "restored", "takes_restitution",
]  # fmt: skip
