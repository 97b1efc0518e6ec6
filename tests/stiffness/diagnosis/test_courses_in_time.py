"""What changes in time along no law is placed at the link or axis that it is of."""

from dataclasses import replace

import numpy as np
import pytest
from small_bench import FEW, MECHANICS, arm, moved_by, names, prepared

from stiffness.diagnosis.diagnose import diagnose
from stiffness.effects.base import marked_point
from stiffness.effects.drift import Drift
from stiffness.effects.gravity_load import GravityLoad
from stiffness.effects.jacobian import (
    EffectJacobian,
    JacobianBlock,
    JointRotation,
    MarkerDisplacement,
    translate,
)
from stiffness.effects.marker_slip import MarkerSlip


@pytest.mark.parametrize("with_its_marks", [True, False])
def test_a_link_that_grows_in_time_is_no_slip_of_many_marks(with_its_marks):
    """A motor on the upper arm warms it up by 50 µm."""
    true = "hysteresis@a4,width_rad=3e-4"
    here = prepared(true).situation
    along = here.origin[:, 3] - here.origin[:, 2]
    hours = here.recording.time / np.ptp(here.recording.time)
    growth = 5e-5 * (1.0 - np.exp(-3.0 * hours))[:, None] * along
    growth /= np.linalg.norm(along, axis=1, keepdims=True)
    parts: list[JacobianBlock] = [translate(3, growth[:, :, None])]
    for m, marker in enumerate(here.recording.markers):
        if with_its_marks and marker.body == "link_2":
            lever = marked_point(here, m) - here.origin[:, 2]
            part = np.sum(lever * along, axis=1) / np.sum(along**2, axis=1)
            parts.append(MarkerDisplacement(m, (part[:, None] * growth)[:, :, None]))
    law = EffectJacobian(1, tuple(parts))
    laws = (*MECHANICS, MarkerSlip(), Drift(), GravityLoad())
    found = diagnose(moved_by(law, np.ones(1), true), arm(), laws)
    assert names(found) == [("hysteresis", "a4")]
    assert found.unexplained_places[0].where == "link_2"
    assert found.unexplained_places[0].depends_on == ("time",)


def test_an_axis_that_is_zeroed_anew_overnight_is_placed_there_and_at_no_link():
    """The link before it can hold it turned, too, by three times the numbers."""
    true = "hysteresis@a2,width_rad=2e-4"
    here = prepared(true).situation
    late = here.recording.time > np.median(here.recording.time)
    law = EffectJacobian(1, (JointRotation(2, late[:, None].astype(float)),))
    made = moved_by(law, np.array([3e-4]), true)
    night = 14 * 3600.0 * late
    times = {"time": made.time + night, "load_time": made.load_time + night}
    found = diagnose(replace(made, **times), arm(), FEW)
    assert names(found) == [("hysteresis", "a2")]
    [place] = found.unexplained_places
    assert (place.where, place.depends_on) == ("a3", ("time",))
