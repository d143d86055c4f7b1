"""Collisions of an upright capsule on a tilted plane, where MuJoCo's tangents are not in the tangent plane."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from impactlaw import Moreau, Stepper

CAPSULE = """<mujoco><option gravity="0 0 0" {option}/>
  <default><geom friction="{friction}" condim="{condim}"/></default><worldbody>
  <geom type="plane" size="1 1 1" quat="{plane}" {of_plane}/>
  <body pos="9 9 9"><freejoint/><geom size=".1"/></body>
  <body pos="{pos}" quat="{capsule}"><freejoint/><geom type="capsule" size=".05 .1" mass="1"/></body>
  </worldbody></mujoco>"""
ARM, GAP = 0.15, -1e-9  # m
UPRIGHT = {
    "as it is": Rotation.identity(),
    "upside down": Rotation.from_euler("y", 180, degrees=True),
    "turned about its axis": Rotation.from_euler("z", 50, degrees=True),
    "nearly": Rotation.from_euler("xy", [1e-9, 2e-9]),
}
TURNED = {
    "about x": Rotation.from_euler("x", 90, degrees=True),
    "about y": Rotation.from_euler("y", 90, degrees=True),  # MuJoCo's first tangent is the normal, the second is 0
    **{f"at random, {k}": Rotation.random(random_state=k) for k in range(6)},
}
EVERY = [(plane, capsule) for plane in TURNED for capsule in UPRIGHT]


def collision(plane, law, velocity, *, capsule=UPRIGHT["as it is"], how="never", friction=".3", condim=3, **options):
    """Return the impact of a capsule on a plane, and the velocity after the step, both in the frame of the plane."""
    xml = CAPSULE.format(
        plane=text(np.roll(plane.as_quat(), 1)),
        capsule=text(np.roll((plane * capsule).as_quat(), 1)),
        pos=text(plane.apply([0.0, 0.0, ARM + GAP])),
        friction=friction,
        condim=condim,
        option=options.get("option", ""),
        of_plane=options.get("of_plane", ""),
    )
    model = mujoco.MjModel.from_xml_string(xml)
    data, stepper = mujoco.MjData(model), Stepper(model, law, contact_model="soft", compiled=how)
    data.qvel[6:] = *plane.apply(velocity[:3]), *capsule.inv().apply(velocity[3:])
    stepper.step(data)
    (event,) = stepper.events
    return event.impact, *(
        np.concatenate([plane.inv().apply(v[6:9]), capsule.apply(v[9:])])
        for v in (event.impact.post_velocity, data.qvel)
    )


def text(numbers):
    return " ".join(map(repr, np.asarray(numbers).tolist()))


def closed_form(impact, velocity, e, mu):
    """Return the velocity after the impact: friction takes mu (1 + e) u, or makes the contact point stick."""
    inertia, arm = impact.collision.mass_matrix[9, 9], ARM + 0.5 * GAP
    slip = np.array(velocity[:2])
    most = np.linalg.norm(slip) / (1.0 + arm**2 / inertia)
    lost = min(mu * (1 + e) * -velocity[2], most) * slip / np.linalg.norm(slip)
    return [*(slip - lost), -e * velocity[2], -lost[1] * arm / inertia, lost[0] * arm / inertia, 0.0]


@pytest.mark.parametrize("how", ["auto", "never"])
@pytest.mark.parametrize("cone", ["elliptic", "pyramidal"])
@pytest.mark.parametrize("e", [0.0, 0.5, 1.0])
def test_an_upright_capsule_slides_or_sticks(e, cone, how):
    velocity = [1.0, 0.5, -1.0, 0.0, 0.0, 0.0]
    for plane, capsule in EVERY:
        for mu in (0.1, 0.9):
            impact, after, left = collision(
                TURNED[plane], Moreau(e), velocity,
                capsule=UPRIGHT[capsule], how=how, friction=str(mu), option=f'cone="{cone}"',
            )  # fmt: skip
            expected, where = closed_form(impact, velocity, e, mu), f"{plane}, {capsule}, {mu}"
            np.testing.assert_allclose(after, expected, rtol=0, atol=1e-7, err_msg=where)
            if e > 0.0:  # it separates, so that MuJoCo's contacts do not act on it
                np.testing.assert_allclose(left, expected, rtol=0, atol=1e-7, err_msg=where)


@pytest.mark.parametrize("how", ["auto", "never"])
@pytest.mark.parametrize("jacobian", ["dense", "sparse"])
@pytest.mark.parametrize("condim", [3, 4, 6])
def test_torsion_and_rolling_are_as_on_a_level_plane(condim, jacobian, how):
    given = {"how": how, "condim": condim, "friction": ".1 .01 .02", "option": f'jacobian="{jacobian}"'}
    velocity = [1.0, 0.5, -1.0, 3.0, 5.0, 7.0]
    _, level, _ = collision(Rotation.identity(), Moreau(0.5), velocity, **given)
    assert (abs(level[5]) < 6.9) == (condim > 3)
    for plane, capsule in EVERY:
        _, after, _ = collision(TURNED[plane], Moreau(0.5), velocity, capsule=UPRIGHT[capsule], **given)
        np.testing.assert_allclose(after, level, rtol=0, atol=1e-6, err_msg=f"{plane}, {capsule}")


def test_a_belt_drives_a_capsule_as_a_level_one():
    velocity, belt = [0.2, 0.1, -1.0, 0.0, 0.0, 0.0], {"of_plane": 'surfacevel="2 0 0 0 0 1"'}
    _, level, _ = collision(Rotation.identity(), Moreau(0.5), velocity, **belt)
    assert level[0] > 0.4
    for plane in TURNED.values():
        _, after, _ = collision(plane, Moreau(0.5), velocity, **belt)
        np.testing.assert_allclose(after, level, rtol=0, atol=1e-7)


@pytest.mark.parametrize("jacobian", ["dense", "sparse"])
@pytest.mark.parametrize("cone", ["elliptic", "pyramidal"])
def test_compiled_code_is_as_the_scheme_in_python(cone, jacobian):
    velocity = [1.0, 0.5, -1.0, 3.0, 5.0, 7.0]
    given = {"condim": 6, "friction": ".1 .01 .02", "option": f'cone="{cone}" jacobian="{jacobian}"'}
    for plane, capsule in EVERY:
        ours, python = (
            collision(TURNED[plane], Moreau(0.5), velocity, capsule=UPRIGHT[capsule], how=how, **given)[2]
            for how in ("auto", "never")
        )
        np.testing.assert_allclose(ours, python, rtol=0, atol=1e-10, err_msg=f"{plane}, {capsule}")
