"""Every law of the registry by its name: a law that is added there is tested here."""

import json

import numpy as np
import pytest
from problems import launched
from scenes import compiled

from impactlaw import Collision, Coulomb, Friction, Moreau, Newton, Stepper, make_law
from impactlaw.errors import RestitutionError, UnknownNameError
from impactlaw.laws import DESCRIPTIONS, LAWS, portable
from impactlaw.laws.registry import takes_restitution


def example(name):
    """Return the law with e = 0.6, without a coefficient, or with a matrix, whichever it takes."""
    for restitution in (0.6, None, [[0.6]]):
        try:
            return make_law(name, restitution)
        except RestitutionError:
            continue
    raise AssertionError(f"law {name!r} takes neither a coefficient, nor nothing, nor a matrix")


@pytest.mark.parametrize("name", LAWS)
def test_one_contact(name):
    c = Collision(np.diag([1.0, 3.0]), [[1.0, -2.0]], [-1.0, 0.5])
    impact = example(name).resolve(c)
    assert impact.violations.is_admissible(1e-8)
    e = impact.post_contact_velocity[0] / -c.pre_contact_velocity[0]
    if name == "any-outcome":
        assert 0.0 <= e <= 1.0
    else:
        assert e == pytest.approx(0.0 if name == "maximal-dissipation" else 0.6, abs=1e-8)


@pytest.mark.parametrize("name", [name for name in LAWS if name not in ("fremond", "routh")])
def test_several_contacts(name):
    for n, k in ((3, 1), (5, 2)):
        impact = example(name).resolve(launched(n, k))
        assert impact.violations.is_admissible(1e-8)
        assert impact.residual < 1e-8


@pytest.mark.parametrize("name", LAWS)
def test_written_down_and_made_again(name, tmp_path):
    law = example(name)
    path = tmp_path / "law.json"
    path.write_text(json.dumps({"law": portable(law)}))
    assert repr(make_law(path)) == repr(law)
    assert name in DESCRIPTIONS


@pytest.mark.parametrize("restitution", [np.array([0.5, 0.2]), np.zeros(2), [0.0, 0.0], 0.5])
def test_maximal_dissipation_takes_no_restitution_but_zero(restitution):
    with pytest.raises(RestitutionError, match="'maximal-dissipation' has restitution 0"):
        make_law("maximal-dissipation", restitution)
    assert make_law("maximal-dissipation", np.float64(0.0)) == make_law("maximal-dissipation", 0)


@pytest.mark.parametrize("number", [0.5 + 0.1j, np.complex128(0.5), np.complex64(0.5 + 0.1j)])
def test_no_restitution_is_complex(number):
    """Numpy would drop the imaginary part with no more than a warning."""
    for name, given in (("moreau", number), ("newton", np.array([number, 0.5])), ("newton", {"a/b": number})):
        with pytest.raises(RestitutionError, match="must be a number in"):
            make_law(name, given)
    with pytest.raises(RestitutionError, match=r"is not an array of numbers: .*; it must be a square array of numbers"):
        make_law("fremond", np.array([[0.0, number], [0.5, 0.0]]))
    with pytest.raises(RestitutionError, match="must be a finite number"):
        make_law("fremond", {("a/b", "b/c"): number})


@pytest.mark.parametrize("options", [{}, {"scheme": "time-stepping"}, {"contact_model": "soft"}])
@pytest.mark.parametrize("name", LAWS)
def test_every_way_to_step(name, options):
    """A ball lands sliding on a rough floor, and does not gain energy."""
    model, data = compiled(
        '<geom name="floor" type="plane" size="5 5 1"/><body name="ball" pos="0 0 .12"><freejoint/>'
        '<geom name="ball" size=".1" mass="1"/></body>',
        option='timestep="2e-3"',
        geom='friction=".3" condim="3"',
    )
    data.qvel[:] = [1.0, 0.0, -1.0, 0.0, 0.0, 0.0]
    stepper = Stepper(model, example(name), **options)
    for _ in range(30):
        stepper.step(data)
        if stepper.events:
            break
    impact = stepper.events[0].impact
    assert impact.violations.is_admissible(1e-7)
    assert impact.energy_change <= 1e-9
    assert impact.post_velocity[0] < 0.9


def test_friction_is_not_lost():
    """Laws without friction of their own get it from Coulomb; Routh's law has its own."""
    c = Collision(np.eye(2), [[0.0, 1.0]], [1.0, -1.0], friction=Friction([[1.0, 0.0]], [0], [0.2]))
    assert make_law("routh", 0.5).has_friction
    assert make_law("routh", 0.5).resolve(c).post_velocity[0] == pytest.approx(0.7)
    assert not make_law("moreau", 0.5).has_friction


@pytest.mark.parametrize("name", ["moro", "", None, 3, ["moreau"]])
def test_what_is_no_name_of_a_law(name):
    for use in (make_law, takes_restitution):
        with pytest.raises(UnknownNameError, match="law"):
            use(name)


def test_friction_asks_the_normal_law_which_contacts_it_is_for():
    law = Coulomb(Newton({"b/a": 0.5, "*foot*": 0.2}, default=0.0))
    assert (law.contact_labels, law.contact_count) == ({"a/b", "*foot*"}, None)
    law = Coulomb(Newton([0.5, 0.2]))
    assert (law.contact_labels, law.contact_count) == (frozenset(), 2)
    law = Coulomb(Moreau(0.5))
    assert (law.contact_labels, law.contact_count) == (frozenset(), None)
