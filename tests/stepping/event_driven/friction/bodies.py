"""Bodies with friction, on level and sloped ground."""

import math
from functools import partial

import scenes

G = 9.81
RK4 = 'timestep="0.005" integrator="RK4"'
compiled = partial(scenes.compiled, option=RK4)


def floor(mu=0.0, condim=3, rest=""):
    return f'<geom name="floor" type="plane" size="9 9 1" condim="{condim}" friction="{mu} 0 0" {rest}/>'


def box(name="box", height=0.1, mu=0.5, half=0.1, mass=1.0):
    return (
        f'<body name="{name}" pos="0 0 {height}"><freejoint/><geom name="{name}" type="box" mass="{mass}" '
        f'size="{half} {half} {half}" friction="{mu} 0 0"/></body>'
    )


def ball(height=0.1, mu=0.5, condim=3, more="0 0"):
    geom = f'<geom name="ball" size=".1" mass="1" condim="{condim}" friction="{mu} {more}"/>'
    return f'<body name="ball" pos="0 0 {height}"><freejoint/>{geom}</body>'


def sloped(angle, option=RK4):
    """Return the option that tilts gravity: the floor becomes an incline that falls towards x."""
    return f'{option} gravity="{G * math.sin(angle)} 0 {-G * math.cos(angle)}"'
