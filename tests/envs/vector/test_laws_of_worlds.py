"""Laws of worlds can be changed like those of single environments, and are set by the same options."""

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import SyncVectorEnv

import impactlaw.envs  # noqa: F401  (registers the environments)
from impactlaw import Moreau, Newton
from impactlaw.errors import OptionError, UncompiledWarning, UnknownNameError
from impactlaw.laws import MaximalDissipation

NAME = "impactlaw/Juggler-v0"


def bounce(vec):
    """Return the velocities after 600 ms in which the paddle rests."""
    for _ in range(60):
        observed, *_, info = vec.step(np.zeros((3, 1)))
    return observed[:, 1], info


def test_a_law_that_is_set_is_in_force_and_stays(vec):
    vec.reset(seed=0)
    own, info = bounce(vec)
    assert list(info["impact/restitution"]) == [0.8] * 3
    vec.reset(seed=0)
    vec.set_attr("law", [Moreau(0.1), Newton(0.8), Newton(0.5)])
    changed, info = bounce(vec)
    assert list(info["impact/restitution"]) == [0.1, 0.8, 0.5]
    assert changed[1] == own[1]
    assert abs(changed[0] - own[0]) > 0.1
    assert vec.get_attr("law") == (Moreau(0.1), Newton(0.8), Newton(0.5))
    vec.set_attr("law", ["moreau", "newton", "newton"])
    vec.set_attr("restitution", 0.3)
    assert vec.get_attr("law") == (Moreau(0.3), Newton(0.3), Newton(0.3))
    assert list(vec.reset(seed=0)[1]["impact/restitution"]) == [0.3] * 3


def test_a_law_can_be_set_as_an_attribute(vec):
    vec.reset(seed=0)
    vec.law = "maximal-dissipation"
    assert vec.get_attr("law") == vec.law == (MaximalDissipation(),) * 3
    assert list(bounce(vec)[1]["impact/restitution"]) == [0.0] * 3
    vec.law = ["moreau", "newton", "newton"]
    vec.restitution = [0.3, 0.4, 0.5]
    assert vec.law == (Moreau(0.3), Newton(0.4), Newton(0.5))
    assert vec.get_attr("restitution") == vec.restitution == (0.3, 0.4, 0.5)
    assert list(vec.reset(seed=0)[1]["impact/restitution"]) == [0.3, 0.4, 0.5]
    with pytest.raises(UnknownNameError, match="moro"):
        vec.law = "moro"
    assert vec.law == (Moreau(0.3), Newton(0.4), Newton(0.5))


@pytest.mark.parametrize("name", [NAME, "impactlaw/RockingBlock-v0"])
def test_an_array_has_one_restitution_for_each_world(name):
    """An array is never read as one coefficient per contact, even where it has as many entries as contacts."""
    some = gymnasium.make_vec(
        name, 2, vectorization_mode="vector_entry_point", law="newton", restitution=np.array([0.4, 1])
    )
    assert some.restitution == (0.4, 1.0)
    some.restitution = np.linspace(0.0, 0.5, 2)
    assert some.restitution == (0.0, 0.5)
    some.law = np.array(["moreau", "newton"])
    assert [law.name for law in some.law] == ["moreau", "newton"]
    with pytest.raises(OptionError, match="2 worlds need as many values of restitution, got 3"):
        some.restitution = np.linspace(0.0, 0.5, 3)


def test_options_of_a_reset_are_for_one_episode(vec):
    assert list(vec.reset(seed=0, options={"restitution": 0.5})[1]["impact/restitution"]) == [0.5] * 3
    mask = np.array([True, False, False])
    info = vec.reset(options={"law": "moreau", "restitution": 0.2, "reset_mask": mask})[1]
    assert list(info["impact/law"]) == ["Moreau(restitution=0.2)"] + ["Newton(restitution=0.5, default=None)"] * 2
    assert list(vec.reset()[1]["impact/restitution"]) == [0.8] * 3


def test_a_law_without_one_coefficient_has_none_in_info(vec):
    """As in a vector environment of single environments, where this law has no such entry."""
    vec.law = ["moreau", Newton({("ball", "paddle"): 0.3}, default=0.5), "maximal-dissipation"]
    for info in (vec.reset(seed=0)[1], vec.step(np.zeros((3, 1)))[4]):
        np.testing.assert_array_equal(info["impact/restitution"], [0.8, np.nan, 0.0])
        assert info["_impact/restitution"].tolist() == [True, False, True]
        assert info["_impact/law"].all()
    np.testing.assert_array_equal(vec.restitution, [0.8, np.nan, 0.0])


def test_options_of_single_environments_make_these(tmp_path):
    with pytest.warns(UncompiledWarning, match="single environments have log:") as warned:
        vec = gymnasium.make_vec(NAME, 2, log=str(tmp_path / "run-{env}.rrd"))
    assert [str(one.filename) for one in warned] == [__file__]
    assert isinstance(vec, SyncVectorEnv)
    vec.reset(seed=0)
    vec.step(np.zeros((2, 1)))
    vec.close()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run-0.rrd", "run-1.rrd"]
    with pytest.raises(TypeError, match="lag"):
        gymnasium.make_vec(NAME, 2, lag="run.rrd")


@pytest.mark.parametrize(
    "options",
    [{"scheme": "event-driven"}, {"friction": "ignore"}, {"contact_model": "soft"}, {"render_mode": "rgb_array"}],
    ids=str,
)
def test_an_option_that_makes_single_environments_is_named(options):
    (name,) = options
    with pytest.warns(UncompiledWarning, match=f"single environments have {name}:"):
        vec = gymnasium.make_vec(NAME, 2, **options)
    assert isinstance(vec, SyncVectorEnv)
    vec.close()
    with pytest.raises(OptionError, match=f"nthread is for compiled worlds, which do not have {name}"):
        gymnasium.make_vec(NAME, 2, nthread=1, **options)
