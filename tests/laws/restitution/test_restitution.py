"""Restitution in all its forms: number, list, matrix, contact label and name of the law; and what is refused."""

import mujoco
import numpy as np
import pytest
from problems import LAWS, OF_SOME, SWAPPED, launched

from impactlaw import Collision, Fremond, LinearMap, MaximalDissipation, Moreau, Newton, Stepper, make_law
from impactlaw.comparison.compare import Comparison, compare
from impactlaw.errors import RestitutionError, UnknownNameError
from impactlaw.laws import LAWS as REGISTRY
from impactlaw.laws import Law
from impactlaw.laws.restitution.from_scene import scene_restitution
from impactlaw.laws.restitution.labels import canonical, check_labels

EXACT = {"rtol": 0, "atol": 1e-12}
LABELLED = ("ball1/floor", "ball1/ball2", "ball2/wall")


def labelled():
    return Collision(np.eye(3), np.eye(3), [-1.0, -2.0, -4.0], labels=LABELLED)


@pytest.mark.parametrize(
    "keys",
    [
        {"ball1/floor": 0.5, "ball1/ball2": 0.25, "ball2/wall": 0.125},
        {"floor/ball1": 0.5, "ball2/ball1": 0.25, "wall/ball2": 0.125},
        {("floor", "ball1"): 0.5, ("ball1", "ball2"): 0.25, ("ball2", "wall"): 0.125},
        {("wall", "ball2"): 0.125, "ball1/floor": 0.5, ("ball2", "ball1"): 0.25, "ball3/floor": 1.0},
    ],
)
def test_newton_by_label(keys):
    law = Newton(keys)
    np.testing.assert_allclose(law.coefficients(labelled()), [0.5, 0.25, 0.125])
    np.testing.assert_allclose(law.resolve(labelled()).post_velocity, [0.5, 0.5, 0.5], **EXACT)
    assert law.contact_labels == {canonical(key) for key in keys}


def test_newton_by_label_with_default_and_without():
    law = Newton({("ball1", "floor"): 0.9}, default=0.5)
    np.testing.assert_allclose(law.coefficients(labelled()), [0.9, 0.5, 0.5])
    with pytest.raises(RestitutionError, match="Newton has no restitution for contact ball1/ball2, and no default"):
        Newton({("ball1", "floor"): 0.9}).resolve(labelled())


def test_fremond_by_label():
    law = Fremond({("floor/ball1", "ball2/ball1"): 0.5, ("ball2/wall", "wall/ball2"): 1.0, ("a/b", "ball1/floor"): 9.0})
    expected = [[0.0, 0.5, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 1.0]]
    np.testing.assert_array_equal(law.restitution_matrix(labelled()), expected)
    assert law.contact_labels == {"ball1/floor", "ball1/ball2", "ball2/wall", "a/b"}
    part = Collision(np.eye(3), np.eye(3)[[2, 1]], [-1.0, -2.0, -4.0], labels=("wall/ball2", "ball1/ball2"))
    np.testing.assert_array_equal(law.restitution_matrix(part), [[1.0, 0.0], [0.0, 0.0]])


@pytest.mark.parametrize("first", ["robot/foot", "a/foot", "zebra/left/foot"])
@pytest.mark.parametrize("second", ["world/floor", "floor", "b/c/d/e"])
@pytest.mark.parametrize("turned", [False, True])
def test_names_with_slashes_are_keys_in_either_order(first, second, turned):
    known = (f"{first}/{second}", "other/thing")
    names = (second, first) if turned else (first, second)
    for key in (names, "/".join(names)):
        check_labels([canonical(key)], known)
        c = Collision(np.eye(2), np.eye(2), [-1.0, -1.0], labels=known)
        np.testing.assert_array_equal(Newton({key: 0.9}, default=0.1).coefficients(c), [0.9, 0.1])
        keyed = Fremond({(key, key): 0.9}).restitution_matrix(c)
        np.testing.assert_array_equal(keyed, [[0.9, 0.0], [0.0, 0.0]])
    with pytest.raises(UnknownNameError):
        check_labels([canonical((first + "x", second))], known)


@pytest.mark.parametrize("key", [("*/foot", "world/floor"), ("world/floor", "*/foot"), "robot/*", "*foot/world*"])
def test_patterns_of_names_with_slashes(key):
    known = ("robot/foot/world/floor", "other/thing")
    check_labels([canonical(key)], known)
    c = Collision(np.eye(2), np.eye(2), [-1.0, -1.0], labels=known)
    np.testing.assert_array_equal(Newton({key: 0.9}, default=0.1).coefficients(c), [0.9, 0.1])


def test_fremond_keyed_cradle_survives_another_order_of_the_contacts():
    pairs = [("b1/b2", "b3/b4"), ("b2/b3", "b3/b2"), ("b3/b4", "b2/b1")]
    law = Fremond(dict.fromkeys(pairs, 1.0))
    c = launched(4, 1)
    for order in ([0, 1, 2], [2, 0, 1], [1, 0, 2]):
        labels = np.array(["b1/b2", "b2/b3", "b3/b4"])[order]
        shuffled = Collision(c.mass_matrix, c.jacobian[order], c.pre_velocity, labels=tuple(labels))
        np.testing.assert_allclose(law.resolve(shuffled).post_velocity, [0, 0, 0, 1], **EXACT)


def test_several_contacts_of_one_label_keep_to_themselves():
    """The label (i, i) means each contact with itself, not with another contact of the same two geoms."""
    c = Collision(np.eye(2), np.eye(2), [-1.0, -2.0], labels=("box/floor", "box/floor"))
    np.testing.assert_array_equal(Fremond({("box/floor", "box/floor"): 0.5}).restitution_matrix(c), 0.5 * np.eye(2))


def test_reversal_of_separate_chains_reverses_each():
    J = np.zeros((4, 7))
    J[:2, :3], J[2:, 3:] = np.diff(np.eye(3), axis=0), np.diff(np.eye(4), axis=0)[:2]
    c = Collision(np.eye(7), J, [1.0, 0.0, 0.0, 2.0, 0.0, 0.0, 5.0])
    impact = Fremond.reversal().resolve(c)
    np.testing.assert_allclose(impact.post_velocity, [0, 0, 1, 0, 0, 2, 5], **EXACT)
    half = Fremond.reversal(0.5).restitution_matrix(c)
    np.testing.assert_array_equal(half, 0.5 * np.kron(np.eye(2), SWAPPED))


@pytest.mark.parametrize(
    ("name", "restitution", "expected"),
    [
        ("maximal-dissipation", None, MaximalDissipation()),
        ("maximal-dissipation", 0, MaximalDissipation()),
        ("moreau", 0.8, Moreau(0.8)),
        ("newton", 0.3, Newton(0.3)),
        ("newton", [0.2, 0.9], Newton([0.2, 0.9])),
        ("newton", {"b/a": 0.2}, Newton({("a", "b"): 0.2})),
        ("reversal", None, Fremond.reversal()),
        ("reversal", 0.9, Fremond.reversal(0.9)),
        (Moreau(0.5), None, Moreau(0.5)),
    ],
)
def test_make_law(name, restitution, expected):
    assert make_law(name, restitution) == expected


def test_make_fremond():
    np.testing.assert_array_equal(make_law("fremond", SWAPPED).restitution_matrix(launched(3, 1)), SWAPPED)
    assert make_law("fremond", {("a/b", "c/b"): 1.0}).contact_labels == {"a/b", "b/c"}


def test_every_registered_law_can_be_made_and_is_among_those_tried_on_every_problem():
    restitution = {"moreau": 0.5, "newton": 0.5, "poisson": 0.5, "fremond": np.eye(2)}
    tried = {type(make(launched(3, 1))) for make in LAWS.values()}
    for name in set(REGISTRY) - OF_SOME:
        law = make_law(name, restitution.get(name))
        assert isinstance(law, Law)
        assert law.resolve(launched(3, 1)).residual < 1e-12
        assert type(law) in tried


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("moro", "'moro'; did you mean 'moreau'"),
        ("newtons", "did you mean 'newton'"),
        ("xyz", "known: any-outcome, "),
    ],
)
def test_unknown_law(name, message):
    with pytest.raises(UnknownNameError, match=message):
        make_law(name, 0.5)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Moreau(-0.1), r"must lie in \[0, 1\], got -0.1"),
        (lambda: Moreau(1.0000001), r"must lie in \[0, 1\]"),
        (lambda: Moreau(np.nan), r"must lie in \[0, 1\], got nan"),
        (lambda: Moreau("bouncy"), "must be a number"),
        (lambda: Moreau([0.5, 0.5]), "must be a number"),
        (lambda: Newton(2.0), r"must lie in \[0, 1\]"),
        (lambda: Newton([0.5, -1.0]), "restitution of contact 1 must lie in"),
        (lambda: Newton([0.5, np.nan]), "restitution of contact 1 must lie in"),
        (lambda: Newton({"b/a": 7}), "restitution of a/b must lie in"),
        (lambda: Newton({"a/b": 0.5}, default=np.inf), "default restitution must lie in"),
        (lambda: Newton(0.5, default=0.5), "default is for a mapping"),
        (lambda: Newton({("a", "b", "c"): 0.5}), "a contact is named"),
        (lambda: Newton({3: 0.5}), "a contact is named"),
        (lambda: Newton({"a/b": 0.5, "b/a": 0.6}), "a/b has two restitutions, 0.5 and 0.6"),
        (lambda: Newton(np.eye(2)), "restitution of contact 0 must be a number"),
        (lambda: Newton([[0.5], [0.1, 0.2]]), "must be a number"),
        (lambda: Fremond(np.ones((2, 3))), r"must be square, got shape \(2, 3\)"),
        (lambda: Fremond(0.5), "must be square"),
        (lambda: Fremond([[1.0, np.nan], [0.0, 1.0]]), "not finite"),
        (lambda: Fremond([["x"]]), r"is not an array of numbers: .*; it must be a square array of numbers"),
        (lambda: Fremond({"a/b": 1.0}), "a key of Fremond is a pair of contact labels"),
        (lambda: Fremond({("a/b", "b/c"): np.inf}), "must be a finite number"),
        (lambda: Fremond({("a/b", 1): 1.0}), "a contact is named"),
        (lambda: Fremond({("a/b", "c/d"): 1.0, ("b/a", "c/d"): 2.0}), "has two restitutions, 1.0 and 2.0"),
        (lambda: Fremond.reversal(1.5), r"must lie in \[0, 1\]"),
        (lambda: LinearMap(np.ones((2, 3))), "linear map must be square"),
        (lambda: LinearMap([[np.inf]]), "linear map has entries that are not finite"),
        (lambda: make_law("moreau"), "law 'moreau' needs a restitution"),
        (lambda: make_law("newton"), "law 'newton' needs a restitution"),
        (lambda: make_law("fremond"), "law 'fremond' needs a restitution"),
        (lambda: make_law("fremond", 0.5), "needs a restitution matrix"),
        (lambda: make_law("maximal-dissipation", 0.5), "has restitution 0"),
        (lambda: make_law(Moreau(0.5), 0.5), "already has its restitution"),
        (lambda: Newton([0.5]).resolve(launched(3, 1)), r"1 coefficients but 2 contacts collide \(0, 1\); key them"),
        (lambda: Fremond(np.eye(3)).resolve(launched(3, 1)), r"\(3, 3\) but 2 contacts collide \(0, 1\); key it"),
        (lambda: LinearMap(np.eye(2)).resolve(launched(3, 1)), r"\(2, 2\) but the velocity has 3 entries"),
    ],
)
def test_wrong_restitution(make, message):
    with pytest.raises(RestitutionError, match=message):
        make()


def test_labels_of_a_law_are_checked_against_those_of_a_scene():
    check_labels(Newton({"floor/ball1": 0.5}).contact_labels, LABELLED)
    with pytest.raises(UnknownNameError, match="unknown contact 'ball1/flor'; did you mean 'ball1/floor'"):
        check_labels(Newton({("ball1", "flor"): 0.5}).contact_labels, LABELLED)


def test_laws_do_not_change():
    matrix = np.eye(2)
    law = Fremond(matrix)
    matrix[0, 1] = 5.0
    np.testing.assert_array_equal(law.restitution_matrix(launched(3, 1)), np.eye(2))
    with pytest.raises(AttributeError):
        Moreau(0.5).restitution = 0.7  # pyright: ignore[reportAttributeAccessIssue]


def test_restitution_that_an_attached_model_brings_is_not_passed_over():
    """MuJoCo puts the prefix in front of the whole name of a <numeric>."""
    child = mujoco.MjSpec.from_string(
        '<mujoco><custom><numeric name="restitution/ball/floor" data=".9"/></custom><worldbody>'
        '<geom name="floor" type="plane" size="1 1 1"/><body name="b" pos="0 0 1"><freejoint/>'
        '<geom name="ball" size=".1"/></body></worldbody></mujoco>'
    )
    parent = mujoco.MjSpec.from_string(
        '<mujoco><custom><numeric name="restitution" data=".3"/></custom><worldbody/></mujoco>'
    )
    parent.attach(child, prefix="p_", frame=parent.worldbody.add_frame())
    model = parent.compile()
    with pytest.raises(RestitutionError, match=r"p_restitution/ball/floor.* would be passed over"):
        Stepper(model, "scene")


@pytest.mark.parametrize(
    "numeric", ['"p_restitution" data=".2"', '"restitution" data=".2 .3 .4"'], ids=["renamed", "three"]
)
def test_nobody_passes_over_restitution_that_is_none_of_a_scene(numeric, tmp_path):
    """Law "scene" refuses it, and so does a comparison that uses the scene's coefficient for another law."""
    text = (
        f"<mujoco><custom><numeric name={numeric}/></custom><worldbody><geom type='plane' size='1 1 1'/>"
        "<body pos='0 0 .2'><freejoint/><geom size='.1'/></body></worldbody></mujoco>"
    )
    with pytest.raises(RestitutionError):
        scene_restitution(mujoco.MjModel.from_xml_string(text))
    (tmp_path / "scene.xml").write_text(text)
    with pytest.raises(RestitutionError):
        compare(Comparison(scene=str(tmp_path / "scene.xml"), duration=0.01), tmp_path)
