"""Laws written as JSON, and made again from it."""

import json
from dataclasses import dataclass

import numpy as np
import pytest

from impactlaw import Coulomb, Fremond, LinearMap, MaximalDissipation, Moreau, Newton, Poisson, make_law
from impactlaw.errors import RestitutionError
from impactlaw.laws import portable, restored


def falling(speed):
    return 1.0 / (1.0 + speed)


@dataclass(frozen=True)
class Own(Moreau):
    """A law from outside the package."""

    name: str = "own"


LAWS = [
    MaximalDissipation(),
    Moreau(1 / 3),
    Newton(0.1),
    Newton([0.1, 0.2]),
    Newton({("a", "b"): 0.1, "knee": 0.5}, default=0.3),
    Newton({("a", "b"): falling}, default=falling),
    Newton([0.1, falling]),
    Poisson(falling),
    Fremond({("a/b", "b/c"): 1.0}),
    Fremond.reversal(0.9),
    Coulomb(Newton({("a", "b"): 0.1}, default=0.3), tangential_restitution=0.2, cone="convex"),
    Own(0.5, name="other"),
]


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_a_law_comes_back_as_it_was(law):
    again = restored(json.loads(json.dumps(portable(law))))
    assert type(again) is type(law)
    assert repr(again) == repr(law)
    assert repr(make_law(json.loads(json.dumps(portable(law))))) == repr(law)


@pytest.mark.parametrize("law", [Fremond([[0.1, 1 / 3], [0, 1]]), LinearMap(np.eye(3) / 7)], ids=["fremond", "map"])
def test_a_matrix_comes_back_to_the_last_bit(law):
    again = restored(json.loads(json.dumps(portable(law))))
    field = "matrix" if isinstance(law, Fremond) else "h"
    np.testing.assert_array_equal(getattr(again, field), getattr(law, field))


def test_a_sparse_matrix_comes_back_dense():
    from scipy.sparse import csr_array

    again = restored(json.loads(json.dumps(portable(Fremond(csr_array(np.eye(2)))))))
    np.testing.assert_array_equal(again.matrix, np.eye(2))


@pytest.mark.parametrize("restitution", [0.5, [0.1, 0.2], {("a", "b"): 0.5}, {"a/b": falling}, falling])
def test_what_a_law_takes_comes_back_too(restitution):
    wanted = repr(make_law("newton", restitution))
    assert repr(make_law("newton", json.loads(json.dumps(portable(restitution))))) == wanted


def test_what_has_no_name_is_refused():
    @dataclass(frozen=True)
    class Local(Moreau):
        pass

    for law in (Newton(lambda speed: 0.5), Local(0.5), Newton({"a/b": lambda speed: 0.5})):
        with pytest.raises(RestitutionError, match="cannot be written down"):
            portable(law)


def test_what_is_not_there_is_refused():
    for place in ("impactlaw.laws.moreau:Moro", "nosuch.module:Law", "law", "os:getcwd", "math:pi"):
        with pytest.raises(RestitutionError, match=place):
            restored({"law class": place})
    with pytest.raises(RestitutionError, match="Moreau has no hardness"):
        restored(portable(Moreau(0.5)) | {"hardness": 1.0})


MOREAU = "impactlaw.laws.moreau:Moreau"


@pytest.mark.parametrize(
    "damaged",
    [
        {"law class": MOREAU},
        {"law class": MOREAU, "restitution": {"entries": 5}},
        {"law class": MOREAU, "restitution": {"entries": [[1]]}},
        {"law class": MOREAU, "restitution": {"entries": [[{"a": 1}, 0.5]]}},
        {"law class": "impactlaw.laws.base:Law"},
        {"law class": ".x:y"},
        {"law class": ":"},
        {"function": 3},
    ],
    ids=str,
)
def test_a_damaged_law_is_told(damaged):
    with pytest.raises(RestitutionError):
        restored(damaged)
    with pytest.raises(RestitutionError):
        make_law(damaged)
