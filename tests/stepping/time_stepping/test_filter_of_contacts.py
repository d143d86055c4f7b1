"""MuJoCo's filter of contacts, a function of the user, during time steps in Python."""

import mujoco
import numpy as np
import pytest

from impactlaw import Moreau, Stepper
from impactlaw.stepping.time_stepping import scheme

BOXES = """<mujoco><option timestep="0.03"/><worldbody><geom type="plane" size="1 1 1"/>
  <body pos="0 0 .12"><freejoint/><geom type="box" size=".1 .05 .02"/></body>
  <body pos="0 0 .3"><freejoint/><geom type="box" size=".1 .05 .02"/></body></worldbody></mujoco>"""


def test_errors_of_a_filter_are_raised_also_where_compiled_code_calls_it(monkeypatch: pytest.MonkeyPatch):
    """Overlaps at the end of steps are opened in compiled code, which looks for contacts and calls the filter."""
    inside, calls, compiled = [False], [0], scheme.for_python

    def watched(part):
        function = compiled(part)

        def called(*given):
            inside[0] = part is scheme.correct_end
            return function(*given)

        return called

    def filter_of_contacts(*given: object) -> int:
        calls[0] += inside[0]
        if inside[0]:
            raise ValueError("from the filter")
        return 0

    def steps() -> None:
        rng = np.random.default_rng(0)
        for _ in range(60):
            mujoco.mj_resetData(model, data)
            data.qvel[:] = rng.normal(size=12) * np.array([1, 1, 3, 20, 20, 20] * 2)
            for _ in range(15):
                inside[0] = False
                stepper.step(data)

    monkeypatch.setattr(scheme, "for_python", watched)
    model = mujoco.MjModel.from_xml_string(BOXES)
    data = mujoco.MjData(model)
    stepper = Stepper(model, Moreau(0.5), scheme="time-stepping", compiled="never")
    mujoco.set_mjcb_contactfilter(filter_of_contacts)
    try:
        with pytest.raises(ValueError, match="from the filter"):
            steps()
        assert mujoco.get_mjcb_contactfilter() is filter_of_contacts
    finally:
        mujoco.set_mjcb_contactfilter(None)
    assert calls[0] > 0
