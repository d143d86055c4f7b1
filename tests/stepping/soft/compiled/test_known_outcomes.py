"""Events of compiled soft steps, where only some of the outcomes that a step has tried are those that it has taken."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import compiled

from impactlaw import Moreau, Stepper
from impactlaw.stepping.impact_event import ImpactSums


def linkage(links):
    """Return links with limits that carry a heavy box, to which they are connected."""
    parts = "".join(
        f"""<body name="link{i}" pos="{0.2 * (i > 0)} 0 {int(i == 0)}"><joint axis="0 1 0" range="-20 20"/>
        <geom type="capsule" fromto="0 0 0 .18 0 0" size=".03" mass="1"/>"""
        for i in range(links)
    )
    return compiled(
        f"""{parts}{"</body>" * links}<body name="box" pos="{0.2 * links} 0 1"><freejoint/>
        <geom type="box" size=".1 .1 .1" mass="5" contype="0" conaffinity="0"/></body>""",
        rest=f'<equality><connect body1="link{links - 1}" body2="box" anchor=".2 0 0"/></equality>',
    )


def packed(boxes, seed):
    """Return boxes that fall between four walls."""
    rng = np.random.default_rng(seed)
    walls = "".join(
        f'<geom type="plane" size="1 1 1" pos="{x} {y} 0" zaxis="{-x} {-y} 0"/>'
        for x, y in ((0.15, 0), (-0.15, 0), (0, 0.15), (0, -0.15))
    )
    bodies = "".join(
        f"""<body pos="{rng.integers(-8, 9) / 100} {rng.integers(-8, 9) / 100} {0.1 + 0.1 * i:.1f}"><freejoint/>
        <geom type="box" size=".07 .06 .05" density="1000"/></body>"""
        for i in range(boxes)
    )
    return compiled(
        f'<geom type="plane" size="5 5 .1"/>{walls}{bodies}',
        option='timestep=".005" cone="elliptic"',
        geom='friction=".9"',
    )


def told(scene, restitution, steps):
    """Take steps; check that the events of each add up to its sums, and return the largest violation and residual."""
    model, data = scene
    stepper, worst = Stepper(model, Moreau(restitution), contact_model="soft"), 0.0
    for _ in range(steps):
        stepper.step(data)
        events, sums = ImpactSums.of(stepper.events), stepper.sums
        assert events.collisions == sums.collisions
        assert events.energy_change == pytest.approx(sums.energy_change, rel=1e-6, abs=1e-9)
        assert events.intensity == pytest.approx(sums.intensity, rel=1e-6)
        for event in stepper.events:
            v = event.impact.violations
            worst = max(worst, max(v.kinematic, v.kinetic, v.energetic) / v.pre_speed, event.impact.residual)
    return worst


@pytest.mark.parametrize(("links", "restitution"), [(2, 0.5), (2, 1.0), (3, 1.0)])
def test_collisions_that_begin_anew_since_constraints_give_way(links, restitution):
    """The outcomes told are those after the constraints have given way, and not those of the attempt before."""
    assert told(linkage(links), restitution, 150) < 1e-9


@pytest.mark.parametrize(("boxes", "seed", "steps"), [(4, 7, 160), (6, 0, 100), (6, 3, 145)])
def test_outcomes_with_contacts_that_open_slowly_are_those_of_the_step(boxes, seed, steps):
    """Impulses that are fitted to such an outcome may miss it by 5e-9 of its speed; those of the step do not."""
    assert told(packed(boxes, seed), 0.5, steps) < 1e-11


def test_collisions_of_an_attempt_that_is_not_the_last_are_not_told():
    model, data = linkage(7)
    data.qvel[:] = np.random.default_rng(8).normal(size=model.nv)
    assert told((model, data), 0.5, 200) < 1e-9
