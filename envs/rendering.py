"""Pictures of a scene, with a display or without one.

What draws: OpenGL through GLFW where there is a display, else through EGL or OSMesa (Debian packages libegl1 and
libosmesa6; Mesa's software drivers will do). The environment variable MUJOCO_GL = glfw, egl or osmesa decides if it is
set. MuJoCo itself reads it when it is first imported, which is too early here, so pictures are drawn by gymnasium's
`MujocoRenderer`, which reads it when it draws first. Where it is not set and there is no display, `choose_backend`, on
import of `impactlaw.envs`, sets it to the library that is there; processes started later inherit it.
"""

from __future__ import annotations

import ctypes.util
import os
import sys
import warnings
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from impactlaw.errors import RenderError

if TYPE_CHECKING:
    from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer

_HEADLESS = {"egl": "EGL", "osmesa": "OSMesa"}  # value of MUJOCO_GL: library, in the order of preference


def has_display() -> bool:
    """Whether a window can open."""
    return not sys.platform.startswith("linux") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def choose_backend() -> None:
    """Set MUJOCO_GL to an OpenGL library that needs no display, if it is not set and there is none."""
    if "MUJOCO_GL" in os.environ or has_display():
        return
    for backend, library in _HEADLESS.items():
        if ctypes.util.find_library(library):
            os.environ["MUJOCO_GL"] = backend
            return


class Pictures:
    """Draws a simulation as the scene's camera ``main`` sees it.

    Args:
        model: the scene; its shadows are switched off, which makes software drivers six times faster.
        data: the state to draw.
        width: of the pictures, pixels.
        height: of the pictures, pixels.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, width: int, height: int):
        self._model = model
        self._data = data
        self.size = width, height
        self._renderer: MujocoRenderer | None = None

    def draw(self, mode: str) -> np.ndarray | None:
        """Return the picture, uint8 (height, width, 3), for "rgb_array"; show it in a window for "human".

        Raises:
            RenderError: there is no OpenGL library, or no display.
        """
        if self._renderer is None:
            self._renderer = self._open(mode)
        return self._renderer.render(mode)

    def close(self) -> None:
        """Close the window, if there is one, and free what the drawing needs."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _open(self, mode: str) -> MujocoRenderer:
        from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer

        backend = os.environ.get("MUJOCO_GL", "")
        if not (backend or has_display()):
            raise RenderError(
                "nothing to draw with: no display, no EGL, no OSMesa; install the Debian package libegl1 or libosmesa6"
            )
        model, (width, height) = self._model, self.size
        model.vis.quality.shadowsize = 0
        model.vis.global_.offwidth, model.vis.global_.offheight = width, height
        renderer = MujocoRenderer(model, self._data, width=width, height=height, camera_name="main")
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")  # GLFW says again, several times, what the error below says
                renderer.render(mode)
        except (mujoco.FatalError, RuntimeError, ImportError, AttributeError, OSError, TypeError) as error:
            raise RenderError(_reason(error, backend)) from None
        return renderer


def _reason(error: Exception, backend: str) -> str:
    tried = f"MUJOCO_GL={backend}" if backend else "GLFW"
    text = str(error).strip().partition("\n")[0]
    return f"cannot draw with {tried} ({text}); without a display install the Debian package libegl1 or libosmesa6"
