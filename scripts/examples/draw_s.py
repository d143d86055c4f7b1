"""Draw S, the set of possible outcomes of a collision, for three touching balls; the first one is launched.

One sees a sector, of 60 degrees in the kinetic metric. Its corners are maximal dissipation, Moreau's law with e = 1 and
the reversal law.
Writes out/possible_outcomes.png.
"""

from pathlib import Path

import matplotlib as mpl
import numpy as np

from impactlaw import Collision, Fremond, MaximalDissipation, Moreau

mpl.use("Agg")
from matplotlib import pyplot as plt

collision = Collision(np.eye(3), np.array([[-1, 1, 0], [0, -1, 1]]), np.array([1, 0, 0]))
S = collision.admissible_set
outcomes = S.sample(4000, 0) @ collision.jacobian.T  # as contact velocities (gamma_1, gamma_2)
figure, axis = plt.subplots(figsize=(5, 4), layout="constrained")
axis.scatter(*outcomes.T, s=2, color="0.75", label="S, 4 000 uniform samples")
laws = {"maximal dissipation": MaximalDissipation(), "Moreau, e = 1": Moreau(1.0), "reversal": Fremond.reversal()}
for name, law in laws.items():
    impact = law.resolve(collision)
    axis.plot(*impact.post_contact_velocity, "o", label=name)
    distance = S.distance(impact.post_velocity)
    print(f"{name:20} gamma+ = {impact.post_contact_velocity.round(4) + 0.0}, distance from S {distance:.0e}")
half_line = np.array([Moreau(e).resolve(collision).post_contact_velocity for e in (0, 1)])
axis.plot(*half_line.T, "k--", linewidth=1, label="Moreau's half-line")
axis.set(xlabel="velocity at contact 1 after, m/s", ylabel="velocity at contact 2 after, m/s", aspect="equal")
axis.legend(fontsize=8)
Path("out").mkdir(exist_ok=True)
figure.savefig("out/possible_outcomes.png", dpi=120)
print("intensities of S reach from {:.4f} to {:.4f}; out/possible_outcomes.png".format(*S.intensity_range()))
