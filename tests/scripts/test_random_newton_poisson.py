"""The shares that the README names, of fewer collisions."""

from scripts.random_newton_poisson import shares


def test_newton_leaves_s_where_contacts_open_and_poisson_never():
    mixed = shares(400, 1, closing=False)
    _, penetrate, gain, _, _ = mixed["Newton"]
    assert 0.4 < penetrate < 0.6
    assert 0.05 < gain < 0.15
    assert mixed["Poisson"][:3] == (0, 0.0, 0.0)


def test_only_poisson_has_distant_effects_where_all_close():
    closing = shares(400, 1, closing=True)
    assert closing["Newton"] == (0, 0.0, 0.0, 0.0, closing["Newton"][4])
    assert 0.15 < closing["Poisson"][3] < 0.35
