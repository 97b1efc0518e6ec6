import os
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from saved_view import entities, viewer_into

from bench.shared.errors import UnknownName, Unusable
from bench.shared.format.folder import write
from bench.shared.recording import UNLOADED, Recording
from scenarios import diagnose, pipelines, real_kr300
from scenarios.pipelines.compare_encoders import (
    ComparisonOutcome,
    answer_of,
    compare_encoders,
)
from scenarios.pipelines.encoder_axes import (
    heldout_comparison,
    rms_of_windows,
    whole_rms,
)
from scenarios.pipelines.inputs import arm_of
from scenarios.pipelines.recording_check import abilities
from scenarios.report.data_files import DECISIONS, read_table
from scenarios.report.sections.dual_encoder import (
    headline,
    write_files,
)
from scenarios.studies.public_recordings import kr300_recording
from stiffness.dual_encoder.motions import SHORTEST
from stiffness.regression.testing import SMALLEST

TWIST = {"delay": 0.0, "compliance": 0.0, "wave": 0.0, "play": 0.0, "lag": 0.0}
ORDER = 97.0


def stream(friction: float = 15.0, seed: int = 7, **true: float) -> Recording:
    """Three motions; a2 is read twice, with gravity, inertia and some friction."""
    size = {**TWIST, **true}
    random = np.random.default_rng(seed)
    times, angles, links, torques, motion = [], [], [], [], []
    for m in range(3):
        time = np.arange(0.0, 8.0, 0.004)
        wave, phase = random.uniform(0.6, 2.2, 4), random.uniform(0, 6, 4)
        swing = random.uniform(0.05, 0.25, 4)
        angle = np.sin(np.outer(time, wave) + phase) @ swing
        ago = np.outer(time - size["delay"], wave)
        speed = np.gradient(angle, time)
        pull = 900.0 * np.cos(angle + 0.4) + 150.0 * np.gradient(speed, time)
        link = np.sin(ago + phase) @ swing - size["compliance"] * pull
        link += size["wave"] * np.sin(ORDER * angle + 0.7)
        link -= 0.5 * size["play"] * np.tanh(speed / 1e-3)
        link += size["lag"] * np.sign(speed)
        link += random.normal(0.0, 5e-6, len(time))
        times.append(time + 60.0 * m)
        angles.append(angle)
        links.append(link)
        torques.append(pull + friction * np.tanh(speed / 1e-3))
        motion.append(np.full(len(time), m))
    rows = sum(map(len, times))
    posture, after = np.zeros((rows, 6)), np.full((rows, 6), np.nan)
    torque = np.zeros((rows, 6))
    posture[:, 1], after[:, 1] = np.concatenate(angles), np.concatenate(links)
    torque[:, 1] = np.concatenate(torques)
    time = np.concatenate(times)
    number = np.concatenate(motion)
    return Recording(
        name="a gear read twice",
        time=time,
        posture_id=number,
        visit=number,
        posture=posture,
        load_time=time,
        stage=np.full(rows, UNLOADED),
        link_posture=after,
        axis_torque=torque,
        rows="stream",
    )


def compare_and_write(recording, model, folder):
    outcome = compare_encoders(recording, model)
    write_files(folder, outcome)
    return outcome.answer, headline(outcome)


def test_the_first_sentence_says_which_axis_is_left_with_how_much(tmp_path):
    answer, said = compare_and_write(
        stream(delay=0.004), real_kr300.MODEL, tmp_path / "answer"
    )
    proof = answer.proof
    assert proof is not None and proof.after_rms_urad is not None
    sizes = f"{proof.after_rms_urad:.0f} instead of {proof.before_rms_urad:.0f} on a2."
    assert f"µrad rms that are left of what the second encoders tell: {sizes}" in said
    assert said.endswith("Named: channel_delay at a2.")
    report = (tmp_path / "answer" / "report.md").read_text()
    assert said in report
    assert "delay_s" not in report and "_rad" not in report


def test_from_python_a_comparison_states_explains_and_draws_itself(tmp_path):
    """`diagnose` chooses it by what the recording holds, and says its sentence."""
    said: list[str] = []
    result = pipelines.diagnose(stream(delay=0.004), real_kr300.MODEL, said.append)
    assert isinstance(result.found, ComparisonOutcome)
    assert said == [headline(result.found)]
    assert "What: channel_delay at a2" in repr(result)
    assert "the nominal one, fitted likewise, by" in repr(result)
    gate = [d for d in result.found.decisions if d.candidate[0] == "joint_compliance"]
    for refused in gate:
        assert refused.reason[1:] in result.why_not("joint_compliance", "a2")
    assert "No gate has decided" in result.why_not("drift", "base")
    assert len(result.figure("a2").axes) == 1
    with pytest.raises(UnknownName, match="a1"):
        result.figure("a1")
    assert result.report(tmp_path / "o").is_file()
    rows = read_table(tmp_path / "o" / DECISIONS)
    assert len(rows) == len(result.found.decisions) > 0
    assert all(row["reason"] for row in rows)


def named(recording: Recording) -> dict[str, dict]:
    axes = heldout_comparison(recording, real_kr300.MODEL)
    answer = answer_of("", axes, 0.0)
    return {n.effect: n.parameters for n in answer.named}


def test_a_delay_is_named_and_no_compliance():
    found = named(stream(delay=0.004))
    assert set(found) == {"channel_delay"}
    delay = found["channel_delay"]["delay_s"]
    assert delay.low < 0.004 < delay.high
    assert delay.estimate == pytest.approx(0.004, rel=0.02)


def test_a_true_compliance_is_named_and_no_delay():
    found = named(stream(compliance=4e-7))
    assert "channel_delay" not in found
    give = found["joint_compliance"]["compliance_rad_per_nm"]
    assert give.estimate == pytest.approx(4e-7, rel=0.1)


def test_friction_in_the_motor_s_torque_is_taken_off_before_a_gear_winds_up():
    recording = stream(compliance=4e-7, friction=300.0)
    axis = heldout_comparison(recording, real_kr300.MODEL)[0]
    found = axis.found
    assert [t.parameters for t in found.terms] == [
        ("compliance_rad_per_nm",),
        ("friction_rad",),
    ]
    assert found.x == pytest.approx([4e-7, 4e-7 * 300.0], rel=0.02)
    assert whole_rms(axis.after) < 1e-5


def test_both_are_named_where_both_are_there():
    found = named(stream(delay=0.004, compliance=4e-7))
    assert {"channel_delay", "joint_compliance"} <= set(found)


def test_a_gear_s_wave_is_named_with_its_order():
    found = named(stream(delay=0.004, wave=6e-5))
    assert found["transmission_error"]["order"].estimate == ORDER
    size = found["transmission_error"]["amplitude_rad"]
    assert size.estimate == pytest.approx(6e-5, rel=0.05)


def test_play_between_directions_is_named():
    found = named(stream(play=2e-4))
    assert found["lost_motion"]["width_rad"].estimate == pytest.approx(2e-4, rel=0.05)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_lag_of_the_report_and_a_delay_are_told_apart(sign, seed):
    """A report that leads is play as well: both are said."""
    draw = np.random.default_rng(seed)
    lag, delay = sign * 10 ** draw.uniform(-4.3, -3.2), sign * draw.uniform(5e-4, 5e-3)
    found = heldout_comparison(stream(seed=seed, lag=lag), real_kr300.MODEL)
    (name,) = answer_of("", found, 0.0).named
    if sign > 0.0:
        size = name.parameters["lag_rad"]
        assert name.effect == "reading_lag"
    else:
        size = name.parameters["width_rad"]
        assert name.effect == "lost_motion"
        assert [e.effect for e in name.equivalents] == ["reading_lag"]
    assert size.estimate == pytest.approx(lag if sign > 0.0 else -2.0 * lag, rel=0.05)
    assert set(named(stream(seed=seed, delay=delay))) == {"channel_delay"}


def test_nothing_between_the_encoders_is_no_finding():
    assert named(stream()) == {}


def compared(axes) -> ComparisonOutcome:
    return ComparisonOutcome(tuple(axes), answer_of("a gear", axes, 1.0), None)


def test_a_motion_that_was_not_fitted_is_predicted_to_the_noise(tmp_path):
    axes = heldout_comparison(stream(delay=0.004, wave=6e-5), real_kr300.MODEL)
    assert whole_rms(axes[0].before) > 2e-4
    assert whole_rms(axes[0].after) < 1e-5
    write_files(tmp_path / "out", compared(axes))
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert {"diagnosis.json", "report.html", "before_after.png"} <= names


def test_a_viewer_opens_on_the_curves_of_both_encoders(monkeypatch, tmp_path):
    opened = viewer_into(monkeypatch, tmp_path / "seen.rrd")
    write(tmp_path / "recording", stream(delay=0.004))
    model, out = real_kr300.MODEL, tmp_path / "out"
    diagnose.main(diagnose.Settings(tmp_path / "recording", model, out, view=True))
    assert len(opened) == 1
    assert {"/a2/nominal", "/a2/named"} <= entities(tmp_path / "seen.rrd")


@pytest.mark.parametrize("torque", [True, False])
def test_the_report_says_of_wind_up_what_the_data_say(torque, tmp_path):
    recording = stream(compliance=4e-7) if torque else stream(delay=0.004)
    if not torque:
        recording = replace(recording, axis_torque=None)
    axes = heldout_comparison(recording, real_kr300.MODEL)
    write_files(tmp_path / "out", compared(axes))
    text = (tmp_path / "out" / "report.md").read_text()
    told = re.search(r"Correlation with a2: (torque -(\S+), )?speed [+-]\d", text)
    assert told is not None and (told[1] is not None) == torque
    assert not torque or float(told[2]) > 0.9
    for foregone in ("looks like wind-up", "is a line of speed", "borrows from"):
        assert foregone not in text


def test_a_recording_without_second_encoders_or_motions_is_refused(tmp_path):
    whole = stream(delay=0.004)
    with pytest.raises(Unusable, match="two are fitted, one judges"):
        heldout_comparison(whole.take(whole.posture_id < 2), real_kr300.MODEL)
    with pytest.raises(Unusable, match=r"A\.mat"):
        kr300_recording(tmp_path)


def test_diagnose_compares_encoders_where_no_tracker_watched(tmp_path):
    recording = stream(delay=0.004)
    write(tmp_path / "recording", recording)
    model, out = real_kr300.MODEL, tmp_path / "out"
    answer = diagnose.main(diagnose.Settings(tmp_path / "recording", model, out))
    assert [(n.effect, n.where) for n in answer.named] == [("channel_delay", "a2")]
    assert (out / "report.html").exists()
    arm = arm_of(model)
    can = {a.question: a.can for a in abilities(recording, arm, [])}
    assert can["what lies between an axis' encoders"]
    few = {
        a.question: a.add
        for a in abilities(recording.take(recording.posture_id < 2), arm, [])
    }
    assert "3 motions" in few["what lies between an axis' encoders"]


def test_check_promises_no_comparison_that_diagnose_refuses(tmp_path):
    """Three motions of which one is too short are two."""
    whole = stream(delay=0.004)
    short = np.flatnonzero(whole.posture_id == 2)[SHORTEST - 1 :]
    recording = whole.take(np.setdiff1d(np.arange(len(whole.time)), short))
    with pytest.raises(Unusable, match="a2 has 2 motions of 50 rows"):
        heldout_comparison(recording, real_kr300.MODEL)
    asked = {a.question: a for a in abilities(recording, arm_of(real_kr300.MODEL), [])}
    between = asked["what lies between an axis' encoders"]
    assert not between.can and "3 motions" in between.add
    assert "a2 has 2 motions of 50 rows" in between.why


@pytest.mark.parametrize(("factor", "says"), [(-1.0, "reversed"), (57.3, "unit")])
def test_a_second_encoder_that_is_read_wrongly_is_said_and_nothing_is_named(
    factor, says, tmp_path
):
    right = stream(delay=0.004)
    assert right.link_posture is not None
    wrong = replace(right, link_posture=factor * right.link_posture)
    answer, told = compare_and_write(wrong, real_kr300.MODEL, tmp_path / "out")
    assert answer.named == ()
    assert answer.detection.p_value == SMALLEST
    assert says in told
    assert says in (tmp_path / "out" / "report.md").read_text()


def test_axes_in_another_order_than_the_model_s_are_compared_alike():
    plain = stream(delay=0.004)
    back = np.arange(6)[::-1]
    names = arm_of(real_kr300.MODEL).axes
    assert plain.link_posture is not None and plain.axis_torque is not None
    turned = replace(
        plain,
        axes=tuple(names[k] for k in back),
        posture=plain.posture[:, back],
        link_posture=plain.link_posture[:, back],
        axis_torque=plain.axis_torque[:, back],
    )
    one, other = (heldout_comparison(r, real_kr300.MODEL)[0] for r in (plain, turned))
    np.testing.assert_allclose(one.after, other.after, atol=1e-9)


@pytest.mark.skipif("REAL_RECORDINGS" not in os.environ, reason="no REAL_RECORDINGS")
def test_the_kr300_s_encoders_lag_by_three_milliseconds_and_do_not_wind_up():
    """By hand: 39 / 61 / 60 µrad on the third motion with one parameter."""
    folder = Path(os.environ["REAL_RECORDINGS"]) / "kr300-two-encoders"
    recording = kr300_recording(folder)
    axes = heldout_comparison(recording, real_kr300.MODEL)
    answer = answer_of(recording.name, axes, 0.0)
    effects = {(n.effect, n.where) for n in answer.named}
    assert {("channel_delay", f"a{k}") for k in (1, 2, 3)} <= effects
    assert "joint_compliance" not in {effect for effect, _ in effects}
    left = [1e6 * rms_of_windows(a.after, a.judged.time) for a in axes]
    assert np.all(np.array(left) <= [39, 61, 60])
