"""The current configuration of a scene: frames, inertia and the factor of the inertia, computed when needed."""

from __future__ import annotations

from math import sqrt
from typing import Any

import mujoco
import numpy as np
import scipy

from impactlaw.mechanics.kinetic_metric import solve_rows
from impactlaw.scene.contacts import mass_matrix, update_positions
from impactlaw.scene.moving_surfaces import Surfaces
from impactlaw.scene.options import BorrowedOptions
from impactlaw.stepping.event_driven.persistent_contact.body_axes import BodyAxes
from impactlaw.stepping.integration import implicit_inertia, locked_joints, restore_state, save_state

_RK4 = int(mujoco.mjtIntegrator.mjINT_RK4)


class Configuration:
    """The model and data of a scene, and the effect of impulses at its configuration.

    MuJoCo factors ``M = L^T D L``, so that here ``R^T = D^1/2 L``: ``|R^T v|`` is the kinetic metric, and
    ``Y = J R^-T`` has ``Y Y^T = G`` (`impactlaw.mechanics.kinetic_metric`). Frames, inertia and factor are those at
    data.qpos, computed when they are first needed. M includes the terms that implicit damping (`end_phase`) and
    equality constraints (`comply`) add to it.

    Attributes:
        data: the state, to be given by `bind`.
        body_axes: the bodies whose torques MuJoCo has along axes that turn with them.
    """

    data: mujoco.MjData

    def __init__(self, model: mujoco.MjModel, options: BorrowedOptions, surfaces: Surfaces | None):
        self.model, self.surfaces, self._options = model, surfaces, options
        self.body_axes = BodyAxes(model)
        self._current = self._factored = False
        self._known: np.ndarray | None = None  # what implicit damping adds to the diagonal of M, (nv,) ...
        self._phase: tuple[float, np.ndarray] | None = None  # ... or its source: duration and M of the phase
        self._damping: np.ndarray | None = None  # D of the last phase, (nv,)
        self._stiffness: np.ndarray | None = None  # what equality constraints that give way add to M, (nv, nv)
        self._root: np.ndarray | None = None  # factor of M with both terms, if there are such constraints, (nv, nv)
        self._diagonal = model.M_rowadr + model.M_rownnz - 1

    def __getstate__(self) -> dict[str, Any]:
        """Leave out the data, which belongs to the caller of a step."""
        return {name: value for name, value in self.__dict__.items() if name != "data"}

    def bind(self, data: mujoco.MjData) -> None:
        """Work on this data, which may have changed in any way."""
        self.data = data
        self._current = self._factored = False
        self._phase = self._known = self._stiffness = None

    @property
    def is_rk4(self) -> bool:
        """Whether the integrator is RK4; the others are semi-implicit."""
        return self._options.integrator == _RK4

    def comply(self, stiffness: np.ndarray | None) -> None:
        """Replace M by ``M + J_eq^T D J_eq``: equality constraints respond to contact and give way, as MuJoCo's do.

        If they were rigid here, a constraint that is being violated would do work on all bodies that it joins. The
        factors of M are discarded: reading the constraints has overwritten them.

        Args:
            stiffness: ``J_eq^T D J_eq``, (nv, nv); None for M alone.
        """
        self._stiffness, self._factored = stiffness, False

    def end_phase(self, duration: float) -> None:
        """Call `update` after a phase of tau s, with ``M + tau D`` for M if the integrator damps implicitly.

        Contact that is held during the phase acts within that integration. With M alone it would throw joints whose
        ``tau D`` is larger than M, and the forces that the next phase feels would not settle.
        """
        if self.is_rk4:
            self._known = self._damping = self._phase = None
        else:
            self._phase = duration, self.data.M.copy()
        self.update()

    def _find_added(self) -> None:
        """Find what implicit damping adds to M, from what the phase left in data, before the next phase."""
        assert self._phase is not None
        duration, M = self._phase
        self._known, self._phase = implicit_inertia(self.model, self.data, duration, M), None
        if duration > 0.0:
            self._damping = None if self._known is None else self._known / duration

    @property
    def added(self) -> np.ndarray | None:
        """What implicit damping adds to the diagonal of M, (nv,), or None; computed when needed, which is rare."""
        if self._phase is not None:
            self._find_added()
        return self._known

    def damp_again(self, added: np.ndarray | None) -> None:
        """Replace M by ``M + tau D`` for a phase that was tried before others, given what `added` was after it."""
        self._known, self._phase, self._factored = added, None, False

    def is_locked(self, timestep: float, ratio: float) -> bool:
        """Return whether damping all but locks a joint in a timestep, s; see `integration.locked_joints`."""
        if self._phase is not None:
            self._find_added()
        return self._damping is not None and locked_joints(self.model, timestep * self._damping, ratio) is not None

    def save(self, state: np.ndarray | None = None) -> np.ndarray:
        """Return everything that the integrator starts from, in the given array if there is one."""
        return save_state(self.model, self.data, state)

    def restore(self, state: np.ndarray) -> None:
        """Restore a state that `save` returned."""
        restore_state(self.model, self.data, state)
        self._current = self._factored = False

    def update(self) -> None:
        """Compute frames and inertia at data.qpos, and move surfaces that move by themselves to their current place."""
        if self.surfaces is not None:
            self.surfaces.place(self.data)
        update_positions(self.model, self.data)
        self._current, self._factored = True, False

    def refresh(self) -> None:
        """Call `update` if the configuration has changed since the last time."""
        if not self._current:
            self.update()

    def in_bodies(self, force: np.ndarray) -> np.ndarray:
        """Return a force, (nv,), whose torques, see `body_axes`, are along the axes of the world, as MuJoCo has it."""
        axes = self.body_axes
        if not len(axes):
            return force
        self.refresh()
        return axes.to_bodies(force, axes.turns(self.data))

    def shift(self, displacement: np.ndarray, *, qpos: np.ndarray | None = None) -> None:
        """Move by a displacement, (nv,), from the current configuration or from another one, (nq,)."""
        moved = (self.data.qpos if qpos is None else qpos).copy()
        mujoco.mj_integratePos(self.model, moved, displacement, 1.0)
        self.data.qpos[:] = moved
        self.update()

    def momentum(self, velocity: np.ndarray) -> np.ndarray:
        """Return ``M v``, (nv,)."""
        self.refresh()
        result = np.empty(self.model.nv)
        mujoco.mj_mulM(self.model, self.data, result, velocity)
        if self._stiffness is not None:
            result += self._stiffness.dot(velocity)
        added = self.added
        return result if added is None else result + added * velocity

    def velocity(self, momentum: np.ndarray) -> np.ndarray:
        """Return ``M^-1 p``, (nv,)."""
        self._factor()
        if self._root is not None:
            return scipy.linalg.lapack.dpotrs(self._root.T, momentum)[0]
        result = np.empty((1, self.model.nv))
        mujoco.mj_solveM(self.model, self.data, result, momentum[None])
        return result[0]

    def jump(self, jacobian: np.ndarray, impulse: np.ndarray) -> np.ndarray:
        """Return ``M^-1 J^T Lambda``, (nv,)."""
        return self.velocity(impulse.dot(jacobian))

    def kinetic_norm(self, velocity: np.ndarray) -> float:
        """Return ``|v| = sqrt(v^T M v)``."""
        return sqrt(max(velocity.dot(self.momentum(velocity)), 0.0))

    def whiten(self, velocity: np.ndarray) -> np.ndarray:
        """Return ``R^T v = R^-1 M v``, (nv,)."""
        return self.whiten_gradients(self.momentum(velocity)[None])[0]

    def whiten_gradients(self, jacobian: np.ndarray) -> np.ndarray:
        """Return ``J R^-T``, (h, nv)."""
        self._factor()
        if self._root is not None:
            return solve_rows(self._root.T, jacobian, transposed=1)
        result = np.empty_like(jacobian)
        mujoco.mj_solveM2(self.model, self.data, result, jacobian, np.sqrt(self.data.qLDiagInv))
        return result

    def _factor(self) -> None:
        if self._factored and self._current:
            return
        self.refresh()
        if self._stiffness is not None:
            dense = mass_matrix(self.model, self.data) + self._stiffness
            if self.added is not None:
                dense[np.diag_indices_from(dense)] += self.added
            self._root, self._factored = np.linalg.cholesky(dense), True
            return
        self._root = None
        M, added = self.data.M, self.added
        own = None if added is None else M[self._diagonal]
        if added is not None:
            M[self._diagonal] += added
        mujoco.mj_factorM(self.model, self.data)
        if own is not None:
            M[self._diagonal] = own
        self._factored = True
