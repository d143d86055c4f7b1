"""Reading of measured collisions from a recording, or from a table in CSV or Parquet."""

import ast
import json
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from impactlaw.errors import ImpactLawError, MeasurementError
from impactlaw.identification.contact_space import collision_of, delassus_by_contacts
from impactlaw.identification.measurements import contact_sets, of_contacts
from impactlaw.mechanics.collision import Collision
from impactlaw.mechanics.friction import Friction

if TYPE_CHECKING:
    import pandas as pd

FULL = ("mass_matrix", "jacobian", "pre_velocity", "post_velocity")
CONTACT = ("pre_contact_velocity", "post_contact_velocity")


class Collisions(NamedTuple):
    """The result of `read_collisions`, which can be unpacked: ``fit(*read_collisions(path))``."""

    collisions: list[Collision]
    post_velocities: list[np.ndarray]


def read_collisions(path: str | Path, *, contacts: str | Sequence[str] | None = None) -> Collisions:
    """Read collisions and the velocities observed after them.

    They are read from a recording (``run.rrd``), or from a table (``.csv``, ``.parquet``) with one row per collision.
    A cell is a number or a list (in CSV as JSON). A table has the columns

    - ``mass_matrix``, ``jacobian``, ``pre_velocity``, ``post_velocity``, and for contacts with friction
      ``friction_jacobian``, ``friction_contact`` (0 if not given), ``friction_coefficient`` (1 if not given); or
    - ``pre_contact_velocity``, ``post_contact_velocity``, and ``delassus``, row by row. If ``delassus`` is missing,
      ``impulse`` is needed; G is then taken to be the same in all collisions of a set of contacts, and follows from
      ``gamma+ - gamma- = G Lambda`` by least squares. A single contact needs neither. With friction the columns
      ``pre_sliding_velocity``, ``post_sliding_velocity`` and ``friction_contact`` are needed, too, and rows of friction
      follow those of contacts in ``delassus``, (h + k, h + k).

    The column ``contacts`` has the labels, "0", "1", ... if not given. Collisions from the second kind of table have
    their own coordinates with M = 1, since only the relative motion at contacts is known.

    Args:
        path: the file.
        contacts: labels of the set of closed contacts whose collisions are read, or the label of one contact; by
            default all collisions are read.

    Raises:
        MeasurementError: the file does not exist, is of another kind, or a row is not a collision; the message names
            row and column.
        RecordingError: the file is not a recording of this package.
    """
    if not isinstance(path, str | os.PathLike):
        raise MeasurementError(f"collisions are read from a file, got {path!r:.100}")
    path = Path(path)
    table = _table(path)
    if table.empty:
        raise MeasurementError(f"{path} has no collisions")
    try:
        if set(FULL) <= set(table):
            return _full(_chosen(table, contacts, "jacobian", 2))
        if set(CONTACT) <= set(table):
            return _contact(_chosen(table, contacts, "pre_contact_velocity", 1))
    except MeasurementError as error:
        raise MeasurementError(f"{path}: {error}") from None
    have = set(table)
    wanted = FULL if len(have & set(FULL)) > len(have & set(CONTACT)) else CONTACT
    missing = ", ".join(name for name in wanted if name not in have)
    found = ", ".join(map(repr, table))
    raise MeasurementError(
        f"{path} has no column {missing}; a table has {', '.join(FULL)} or {', '.join(CONTACT)}, this one has "
        f"{found:.150}"
    )


def _chosen(table: "pd.DataFrame", contacts: str | Sequence[str] | None, name: str, ndim: int) -> "pd.DataFrame":
    """Return the rows of a set of contacts, with their numbers; ``name`` is a column with an entry for each contact."""
    if contacts is None:
        return table
    rows = table.to_dict("records")
    labels = [_labels(row, i, len(_array(row, name, i, ndim))) for i, row in enumerate(rows)]
    return table.iloc[of_contacts(contacts, contact_sets(labels))]


def _table(path: Path) -> "pd.DataFrame":
    import pandas as pd

    if path.suffix == ".rrd":
        from impactlaw.recording import read_log

        return read_log(path).collisions
    if path.suffix not in (".csv", ".parquet"):
        raise MeasurementError(f"{path} is neither a recording (.rrd) nor a table (.csv, .parquet)")
    if not path.is_file():
        raise MeasurementError(f"{path} is not a file" if path.exists() else f"there is no file {path}")
    try:
        return pd.read_csv(path) if path.suffix == ".csv" else pd.read_parquet(path).reset_index(drop=True)
    except (ValueError, OSError) as error:  # pandas' parser errors are ValueErrors
        reason = str(error).strip().partition("\n")[0]
        raise MeasurementError(f"{path} cannot be read as a table: {reason}") from None


def _full(table: "pd.DataFrame") -> Collisions:
    collisions, after = [], []
    for i, row in zip(table.index, table.to_dict("records"), strict=True):
        M, J = (_array(row, name, i, 2) for name in ("mass_matrix", "jacobian"))
        v, post = (_array(row, name, i, 1) for name in ("pre_velocity", "post_velocity"))
        friction, labels = None, _labels(row, i, len(J))
        try:
            if _given(row, "friction_jacobian"):
                J_t = _array(row, "friction_jacobian", i, 2)
                friction = Friction(J_t, _friction_contact(row, i, len(J_t)), _coefficients(row, i, len(J_t)))
            collisions.append(Collision(M, J, v, labels=labels, friction=friction))
        except MeasurementError:
            raise
        except ImpactLawError as error:
            raise MeasurementError(f"row {i}: {error}") from None
        if post.shape != v.shape:
            raise MeasurementError(f"row {i}: post_velocity has {len(post)} numbers, pre_velocity {len(v)}")
        after.append(post)
    return Collisions(collisions, after)


def _contact(table: "pd.DataFrame") -> Collisions:
    rows = list(zip(table.index.tolist(), table.to_dict("records"), strict=True))
    before, after, labels, contacts = [], [], [], []
    for i, row in rows:
        gamma, plus = (_array(row, name, i, 1) for name in CONTACT)
        if gamma.shape != plus.shape:
            raise MeasurementError(f"row {i}: {len(gamma)} contact velocities before, {len(plus)} after")
        labels.append(_labels(row, i, len(gamma)))
        if _given(row, "surface_velocity") and _given(row, "post_surface_velocity"):
            surfaces = [_array(row, name, i, 1) for name in ("surface_velocity", "post_surface_velocity")]
            if not np.array_equal(surfaces[0], surfaces[1]):
                raise MeasurementError(f"row {i}: a surface whose velocity jumps has struck; leave such collisions out")
        sliding = [np.zeros(0), np.zeros(0)]
        if _given(row, "pre_sliding_velocity") or _given(row, "post_sliding_velocity"):
            sliding = [_array(row, name, i, 1) for name in ("pre_sliding_velocity", "post_sliding_velocity")]
            if sliding[0].shape != sliding[1].shape:
                raise MeasurementError(f"row {i}: {len(sliding[0])} sliding velocities before, {len(sliding[1])} after")
        k = len(sliding[0])
        contact = _friction_contact(row, i, k)
        if len(contact) != k:
            raise MeasurementError(f"row {i}: friction_contact has {len(contact)} entries for {k} sliding velocities")
        before.append(np.concatenate([gamma, sliding[0]]))
        after.append(np.concatenate([plus, sliding[1]]))
        contacts.append(contact)
    sizes = [(i, len(own), len(of_rows)) for (i, _), own, of_rows in zip(rows, labels, contacts, strict=True)]
    impulses, given = (
        [read(row, *size) for (_, row), size in zip(rows, sizes, strict=True)] for read in (_impulses, _delassus)
    )
    known = delassus_by_contacts(table.index.tolist(), given, labels, contacts, before, after, impulses)
    collisions, velocities = [], []
    for j, (i, row) in enumerate(rows):
        mu = _coefficients(row, i, len(contacts[j]))
        try:
            c, v = collision_of(known[j], before[j], after[j], labels[j], contacts[j], mu)
        except ImpactLawError as error:
            raise MeasurementError(f"row {i}: {error}") from None
        collisions.append(c)
        velocities.append(v)
    return Collisions(collisions, velocities)


def _delassus(row: dict[Any, Any], i: int, h: int, k: int) -> np.ndarray | None:
    if not _given(row, "delassus"):
        return None
    G, n = _array(row, "delassus", i, None).ravel(), h + k
    if G.size != n * n:
        rows = f"{h} contacts" + (f" and {k} rows of friction" if k else "")
        raise MeasurementError(f"row {i}: delassus has {G.size} numbers, {rows} need {n * n}")
    return G.reshape(n, n)


def _impulses(row: dict[Any, Any], i: int, h: int, k: int) -> np.ndarray | None:
    if not _given(row, "impulse"):
        return None
    impulse = _array(row, "impulse", i, 1)
    if len(impulse) != h:
        raise MeasurementError(f"row {i}: {len(impulse)} impulses for {h} contacts")
    if k:
        if not _given(row, "friction_impulse"):
            return None
        impulse = np.concatenate([impulse, _array(row, "friction_impulse", i, 1)])
        if len(impulse) != h + k:
            raise MeasurementError(f"row {i}: {len(impulse) - h} friction impulses for {k} sliding velocities")
    return impulse


def _friction_contact(row: dict[Any, Any], i: int, k: int) -> np.ndarray:
    if not _given(row, "friction_contact"):
        return np.zeros(k, dtype=int)
    contact = _array(row, "friction_contact", i, 1)
    if (contact % 1 != 0).any():
        raise MeasurementError(f"row {i}: friction_contact must be whole numbers")
    return contact.astype(int)


def _coefficients(row: dict[Any, Any], i: int, k: int) -> np.ndarray:
    if not _given(row, "friction_coefficient"):
        return np.ones(k)
    mu = _array(row, "friction_coefficient", i, 1)
    if len(mu) not in (1, k):
        raise MeasurementError(f"row {i}: {len(mu)} friction coefficients for {k} rows of friction")
    return np.full(k, mu[0]) if len(mu) == 1 else mu


def _labels(row: dict[Any, Any], i: int, h: int) -> tuple[str, ...]:
    if not _given(row, "contacts"):
        return tuple(map(str, range(h)))
    value = _parsed(row["contacts"])
    names = tuple(map(str, value.split() if isinstance(value, str) else np.ravel(value)))
    if len(names) != h:
        raise MeasurementError(f"row {i}: {len(names)} contacts ({', '.join(names)}), but {h} rows of numbers")
    return names


def _given(row: dict[Any, Any], name: str) -> bool:
    value = _parsed(row.get(name))
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return False
    return len(value) > 0 if isinstance(value, list) else np.size(value) > 0


def _parsed(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    for parse in (json.loads, ast.literal_eval):
        try:
            return parse(value)
        except (ValueError, SyntaxError, RecursionError, MemoryError, TypeError):
            continue
    return value


def _array(row: dict[Any, Any], name: str, i: int, ndim: int | None) -> np.ndarray:
    """Return a cell as an array with ``ndim`` dimensions; a number becomes an array with one entry."""
    value = _parsed(row.get(name))
    if hasattr(value, "tolist"):
        value = value.tolist()
    try:
        array = np.array([np.asarray(part, dtype=float) for part in value] if isinstance(value, list) else value, float)
    except (TypeError, ValueError):
        raise MeasurementError(f"row {i}: {name} is not numbers: {value!s:.40}") from None
    if array.ndim == 0:
        array = array.reshape((1,) * (1 if ndim is None else ndim))
    if ndim is not None and array.ndim != ndim:
        kind = "a list of numbers" if ndim == 1 else "a list of rows"
        raise MeasurementError(f"row {i}: {name} must be {kind}, got shape {array.shape}")
    if not np.isfinite(array).all():
        raise MeasurementError(f"row {i}: {name} has entries that are not finite")
    return array
