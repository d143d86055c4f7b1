"""Chains, cradles and stacks of any size: touching, with the given masses and velocities."""

import mujoco
import numpy as np
import pytest
from scenes import chain_labels, detect, label

from impactlaw.errors import SceneError
from impactlaw.models import load
from impactlaw.models.builder import chain, cradle, stack


def box_labels(n: int) -> list[str]:
    pairs = ["floor/box1", *(text.replace("ball", "box") for text in chain_labels(n))]
    return [pair for pair in pairs for _ in range(4)]


def started(spec: mujoco.MjSpec):
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    return model, data


@pytest.mark.parametrize("n", [1, 3, 10, 100])
@pytest.mark.parametrize(
    ("build", "labels"),
    [
        (chain, chain_labels),
        (cradle, chain_labels),
        (stack, lambda n: ["floor/ball1", *chain_labels(n)]),
        (lambda n: stack(n, shape="box"), box_labels),
    ],
    ids=["chain", "cradle", "stack", "stack of boxes"],
)
def test_builder_touches_exactly(build, labels, n):
    model, data = started(build(n))
    contacts = detect(model, data)
    assert [label(model, c) for c in sorted(contacts, key=lambda c: (c.geom1, c.geom2))] == labels(n)
    assert all(c.dist == 0 and c.dim == 1 for c in contacts)
    assert 0 <= model.numeric("restitution").data[0] <= 1


@pytest.mark.parametrize("build", [chain, cradle, stack])
def test_builder_with_inexact_radius_touches_within_the_tolerance(build):
    model, data = started(build(100, radius=0.1))
    contacts = detect(model, data)
    assert len(contacts) == model.nbody - 1 - (build is not stack)
    assert all(abs(c.dist) < 1e-12 for c in contacts)


def test_builder_is_the_scene():
    built = {"ball_chain": chain(3), "newtons_cradle": cradle(5), "ball_stack": stack(10, drop=0.125)}
    for name, spec in built.items():
        model, data = started(spec)
        scene, scene_data = load(name)
        assert model.opt.integrator == scene.opt.integrator
        assert model.opt.timestep == scene.opt.timestep
        for attribute in ("qpos", "qvel"):
            np.testing.assert_array_equal(getattr(data, attribute), getattr(scene_data, attribute))
        matrices = []
        for m, d in ((model, data), (scene, scene_data)):
            mujoco.mj_forward(m, d)
            matrices.append(np.zeros((m.nv, m.nv)))
            mujoco.mj_fullM(m, d, matrices[-1])
        np.testing.assert_allclose(*matrices, rtol=1e-14)
        np.testing.assert_allclose(model.opt.gravity, scene.opt.gravity)


def test_builder_masses_and_launched():
    model, data = started(chain(4, mass=[1, 2, 3, 4], launched=2, restitution=0.3))
    np.testing.assert_array_equal(model.body_mass[1:], [1, 2, 3, 4])
    np.testing.assert_array_equal(data.qvel, [1, 1, 0, 0])
    assert model.numeric("restitution").data[0] == 0.3
    np.testing.assert_array_equal(started(stack(3, mass=np.full(3, 2.0)))[0].body_mass[1:], [2, 2, 2])


def test_builder_refuses_what_does_not_fit():
    for call, message in (
        (lambda: chain(0), "at least one"),
        (lambda: chain(3, mass=[1, 2]), "masses"),
        (lambda: cradle(3, launched=4), "cannot launch 4 of 3"),
        (lambda: stack(3, shape="cone"), "cone"),
        (lambda: chain(2.5), "whole number of bodies, at least one, got 2.5"),
        (lambda: chain("x"), "whole number of bodies, at least one, got 'x'"),
        (lambda: chain(3, launched=1.5), "cannot launch 1.5 of 3"),
        (lambda: chain(3, radius=-1), "radius must be a positive number, got -1"),
        (lambda: chain(3, mass=-1), "mass must be a positive number, got -1"),
        (lambda: chain(3, mass=[1, 2, "x"]), "mass must be a positive number, got 'x'"),
        (lambda: chain(3, mass="x"), "mass must be a positive number, got 'x'"),
        (lambda: chain(3, restitution=2), r"restitution must be a number in \[0, 1\], got 2"),
        (lambda: cradle(3, length=0), "length must be a positive number, got 0"),
        (lambda: stack(3, drop="x"), "drop must be a number, m, got 'x'"),
    ):
        with pytest.raises(SceneError, match=message):
            call()
