"""Record a run and read it into pandas: which pairs collide, how often, and how much energy each collision takes.

One sees the break of a rack of billiard balls as a table with one row per collision. `rerun breaks.rrd` shows the same
file as an animation. Writes breaks.rrd.
"""

from impactlaw import Stepper
from impactlaw.models import load
from impactlaw.recording import Recorder, read_log

model, data = load("billiard_rack")
stepper = Stepper(model, "scene")
with Recorder(model, "breaks.rrd", law=stepper.law, scene="billiard_rack") as recorder:
    while data.time < 1.2:
        stepper.step(data)
        recorder.step(data, stepper.events)

recording = read_log("breaks.rrd")
table = recording.collisions
table["number"] = table.contacts.map(len)
print(table[["time", "number", "intensity", "energy_change", "residual"]].head(8).to_string(), "\n...\n")
pairs = recording.contact_summary().sort_values("total_impulse", ascending=False)
print(pairs.head(6).to_string())
