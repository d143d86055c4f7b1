"""Scenes of bodies that overlap."""

import scenes

from impactlaw import Moreau, Stepper

H = 0.002
BALL = '<geom name="ball" type="sphere" size=".1" mass="2"/>'
STATIC_LID = '<geom name="lid" type="box" pos="0 0 {z}" size="1 1 .1"/>'


def build(world, rest="", *, gravity="0 0 0", integrator="Euler"):
    option = f'timestep="{H}" integrator="{integrator}" gravity="{gravity}"'
    return scenes.compiled(world, rest, option=option, geom='condim="1"')


def slider(name, x, mass, *, axes=("1 0 0",), size=0.1):
    joints = "".join(f'<joint type="slide" axis="{axis}"/>' for axis in axes)
    geom = f'<geom name="{name}" type="sphere" size="{size}" mass="{mass}"/>'
    return f'<body pos="{x}">{joints}{geom}</body>'


def pushed(model, data):
    """Step once while all bodies are at rest; the configuration afterwards is the one that was pushed out."""
    stepper = Stepper(model, Moreau(0.5), overlap="push-out")
    stepper.step(data)
    assert stepper.events == ()
    return stepper
