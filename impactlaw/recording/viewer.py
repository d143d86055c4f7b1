"""The rerun viewer: its layout and styles, and how to open it on a running simulation."""

from __future__ import annotations

import os
import shutil
import sys
import sysconfig
from typing import Any

import mujoco
import numpy as np

from impactlaw.errors import RecordingError
from impactlaw.recording.layout import APPLICATION, COLLISIONS, CONTACTS, ENERGY, MARKS, PLOTTED, SCENE, SIM_TIME

_PORT = 9876
_DISTANCE = 1.2  # of the eye, in extents of the model


def blueprint(model: mujoco.MjModel) -> Any:
    """Return the layout: the scene, in the initial view of MuJoCo's viewer, and energies, collisions and their log."""
    import rerun.blueprint as rrb

    azimuth, elevation = np.radians([model.vis.global_.azimuth, model.vis.global_.elevation])
    forward = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    target = model.stat.center
    place = target - _DISTANCE * model.stat.extent * np.array(forward)
    eye = rrb.EyeControls3D(position=place, look_target=target, eye_up=[0, 0, 1])

    shown, plots = (f"{SCENE}/**", CONTACTS, MARKS), [f"{COLLISIONS}/{name}" for name in PLOTTED]
    columns = rrb.TextLogColumns(text_log_columns=["LogLevel", "Body"])
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Spatial3DView(
                name="scene", origin="/", contents=[f"+ {path}" for path in shown], eye_controls=eye, line_grid=False
            ),
            rrb.Vertical(
                rrb.TimeSeriesView(name="energy, J", origin="/", contents=[f"+ {ENERGY}"]),
                rrb.TimeSeriesView(name="collisions", origin="/", contents=[f"+ {path}" for path in plots]),
                rrb.TextLogView(name="collision log", origin="/", contents=[f"+ {COLLISIONS}"], columns=columns),
            ),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(timeline=SIM_TIME, state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
    )


def send_blueprint(stream: Any, model: mujoco.MjModel) -> None:
    """Send the layout to a stream.

    Rerun's own function would never release the stream on which it makes the layout, or the stream's two threads.
    """
    import rerun_bindings as bindings
    from rerun.recording_stream import RecordingStream

    options = dict.fromkeys(("make_default", "make_thread_default"), False)
    own = RecordingStream(APPLICATION, send_properties=False)
    own.inner = bindings.new_blueprint(application_id=APPLICATION, default_enabled=True, **options)
    own.set_time("blueprint", sequence=0)
    blueprint(model)._log_to_stream(own)
    bindings.send_blueprint(own.memory_recording().storage, False, True, recording=stream.to_native())
    own.disconnect()


def log_styles(stream: Any) -> None:
    """Log the styles of energies, contacts and marks, once."""
    import rerun as rr

    blue, orange, green, red = (77, 135, 214), (230, 145, 56), (120, 190, 110), (220, 60, 60)
    kinetic = rr.SeriesLines(colors=[orange, blue, green], names=["kinetic", "potential", "total"])
    stream.log(ENERGY, kinetic, static=True, strict=True)
    names = {"intensity": "intensity, sqrt(J)", "energy_change": "energy change, J"}
    for name, color in zip(PLOTTED, (orange, red), strict=True):
        points = rr.SeriesPoints(colors=[color], names=[names[name]], marker_sizes=[4])
        stream.log(f"{COLLISIONS}/{name}", points, static=True, strict=True)
    small, large = rr.Radius.ui_points(3), rr.Radius.ui_points(5)
    stream.log(CONTACTS, rr.Points3D.from_fields(radii=small, colors=green), static=True, strict=True)
    stream.log(MARKS, rr.Points3D.from_fields(radii=large, colors=red), static=True, strict=True)
    arrows = rr.Arrows3D.from_fields(radii=rr.Radius.ui_points(2), colors=red)
    stream.log(MARKS, arrows, static=True, strict=True)


def spawn_viewer() -> Any:
    """Open the viewer in a new window, or use one that is open, and return a sink that feeds it."""
    import rerun as rr

    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise RecordingError("there is no display to view the run on; record it and open the file where there is one")
    places = os.pathsep.join([sysconfig.get_path("scripts"), os.environ.get("PATH", "")])
    try:
        rr.spawn(port=_PORT, connect=False, executable_path=shutil.which("rerun", path=places))
    except RuntimeError as error:
        raise RecordingError(f"the rerun viewer did not open: {str(error).strip().splitlines()[0]}") from None
    return rr.GrpcSink(f"rerun+http://127.0.0.1:{_PORT}/proxy")
