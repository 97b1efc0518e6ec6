"""Second encoders of arms whose truth is made here, without the bench."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from bench import patch
from bench.shared.recording import UNLOADED, Recording
from scenarios import real_kr300
from scenarios.pipelines.compare_encoders import answer_of, compare_encoders
from scenarios.pipelines.encoder_axes import heldout_comparison, whole_rms
from scenarios.pipelines.schema import Answer
from scenarios.report.sections.dual_encoder import write_files

NOISE = 5e-6
MASS, OUT, INERTIA = 20.0, 0.3, 0.01
"""Of each link of `heavy`: kg, m beside its axis, kg m^2."""
PLAIN = real_kr300.MODEL


def moved(motions: int = 4) -> Recording:
    """Move a1 and a2; their second encoders read the same and noise."""
    random = np.random.default_rng(11)
    time = np.arange(0.0, 8.0, 0.01)
    rows = motions * len(time)
    posture = np.zeros((rows, 6))
    for m in range(motions):
        for k in (0, 1):
            rate, phase = random.uniform(0.6, 2.2, 4), random.uniform(0.0, 6.0, 4)
            swing = random.uniform(0.05, 0.25, 4)
            own = slice(m * len(time), (m + 1) * len(time))
            posture[own, k] = np.sin(np.outer(time, rate) + phase) @ swing
    number = np.repeat(np.arange(motions), len(time))
    link = np.full((rows, 6), np.nan)
    link[:, :2] = posture[:, :2] + random.normal(0.0, NOISE, (rows, 2))
    stamp = np.tile(time, motions) + 60.0 * number
    return Recording(
        name="two gears read twice",
        time=stamp,
        posture_id=number,
        visit=number,
        posture=posture,
        load_time=stamp,
        stage=np.full(rows, UNLOADED),
        link_posture=link,
        encoder_repeatability=NOISE,
        rows="stream",
    )


def rates(recording: Recording, k: int) -> tuple[np.ndarray, np.ndarray]:
    """Return speed and acceleration of an axis, motion by motion."""
    speed = np.zeros(len(recording.time))
    acceleration = np.zeros(len(recording.time))
    for m in np.unique(recording.posture_id):
        own = recording.posture_id == m
        speed[own] = np.gradient(recording.posture[own, k], recording.time[own])
        acceleration[own] = np.gradient(speed[own], recording.time[own])
    return speed, acceleration


def load(recording: Recording, k: int) -> np.ndarray:
    """Return a torque that the axis' own angle does not tell: it hangs on the other."""
    q = recording.posture
    angle = 0.6 * q[:, k] - 1.3 * q[:, 1 - k] + 0.4 * recording.posture_id
    return 700.0 * np.cos(angle) + 150.0 * rates(recording, k)[1]


def plus(recording: Recording, k: int, more: np.ndarray) -> Recording:
    link = np.array(recording.link_posture)
    link[:, k] += more
    return replace(recording, link_posture=link)


def with_torque(recording: Recording, *columns: np.ndarray) -> Recording:
    torque = np.zeros_like(recording.posture)
    torque[:, : len(columns)] = np.stack(columns, axis=1)
    return replace(recording, axis_torque=torque)


def late(recording: Recording, k: int, delay: float) -> Recording:
    """Let what the second encoder of an axis tells be `delay` s old."""
    link = np.array(recording.link_posture)
    for m in np.unique(recording.posture_id):
        own = recording.posture_id == m
        time, angle = recording.time[own], recording.posture[own, k]
        link[own, k] += CubicSpline(time, angle)(time - delay) - angle
    return replace(recording, link_posture=link)


def wound(recording: Recording, give: float, constant: float, growing: float):
    """Wind a2 up; its motor feels friction that winds up nothing."""
    speed, pull = rates(recording, 1)[0], load(recording, 1)
    motor = pull + constant * np.tanh(speed / 0.01) + growing * speed
    idle = np.zeros_like(motor)
    return with_torque(plus(recording, 1, -give * pull), idle, motor)


def of(answer: Answer, where: str) -> dict[str, dict]:
    return {n.effect: n.parameters for n in answer.named if n.where == where}


def asked(recording: Recording, model: Path = PLAIN) -> Answer:
    return answer_of("", heldout_comparison(recording, model), 0.0)


def changed(folder: Path, *changes: tuple[str, str]) -> Path:
    """Write the six hinges with some of their text changed."""
    text = PLAIN.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    file = folder / "arm.xml"
    file.write_text(text)
    return file


def heavy(folder: Path, spring: float = 0.0) -> Path:
    """Give the hinges masses beside their axes, which gravity pulls at."""
    changes = [
        ('gravity="0 0 0"', 'gravity="0 -9.81 0"'),
        ('mass="1" pos="0 0 0.05"', f'mass="{MASS}" pos="{OUT} 0 0.05"'),
    ]
    if spring:
        changes.append(('armature="0.1"', f'armature="0.1" stiffness="{spring}"'))
    return changed(folder, *changes)


def hanging(recording: Recording) -> np.ndarray:
    """Return what holds a2 of the heavy hinges while a1 stands, by hand."""
    own = 5 * MASS * 9.81 * OUT * np.cos(recording.posture[:, 1])
    return own + 5 * (INERTIA + MASS * OUT**2) * rates(recording, 1)[1]


def still_first(recording: Recording) -> Recording:
    """Let a1 stand, and forget that it was read twice."""
    posture, link = recording.posture.copy(), np.array(recording.link_posture)
    posture[:, 0], link[:, 0] = 0.0, np.nan
    return replace(recording, posture=posture, link_posture=link)


def test_what_no_name_explains_is_unexplained_at_the_axis_that_differs_most():
    recording = moved()
    strange = np.sin(0.9 * recording.time + 2.5 * recording.posture_id**2)
    recording = plus(recording, 0, 1e-4 * strange)
    answer = asked(plus(recording, 1, 4e-4 * strange))
    assert answer.verdict == "unexplained"
    assert answer.detection.p_value < 0.005
    assert answer.unexplained is not None and answer.unexplained.where == "a2"
    assert "a2_tau_nm" in answer.unexplained.signature
    assert answer.proof is not None
    assert answer.proof.noise_rms_urad == pytest.approx(1e6 * NOISE)


def test_what_is_left_is_measured_and_not_recited():
    recording = moved()
    bent = 2e-4 * np.abs(recording.posture[:, 1])  # no wave, but the angle tells it
    slow = 2e-4 * np.sin(0.9 * recording.time + 2.5 * recording.posture_id**2)
    told = [asked(plus(recording, 1, x)).unexplained for x in (bent, slow)]
    assert told[1] is not None and "angle" in told[1].signature
    assert told[0] is None or told[0].signature != told[1].signature


def test_nothing_but_the_stated_noise_is_no_mismatch():
    answer = asked(moved())
    assert answer.verdict == "no_mismatch" and answer.named == ()


def test_a_model_s_masses_name_a_wind_up_where_no_torque_was_read(tmp_path):
    recording = still_first(moved())
    recording = plus(recording, 1, -2e-6 * hanging(recording))
    answer = asked(recording, heavy(tmp_path))
    found = of(answer, "a2")
    assert set(found) == {"joint_compliance"}
    give = found["joint_compliance"]["compliance_rad_per_nm"]
    assert give.estimate == pytest.approx(2e-6, rel=0.03)
    assert any(w.code == "torque" and w.where == "a2" for w in answer.warnings)


def test_friction_of_the_motor_feigns_neither_delay_nor_play():
    answer = asked(wound(moved(), 2.5e-6, constant=60.0, growing=250.0))
    assert answer.verdict == "explained"
    found = of(answer, "a2")
    assert set(found) == {"joint_compliance"} and not of(answer, "a1")
    give = found["joint_compliance"]["compliance_rad_per_nm"]
    assert give.estimate == pytest.approx(2.5e-6, rel=0.01)


def test_one_delay_is_found_on_all_axes_though_friction_hides_it_on_one():
    recording = wound(moved(), 2.5e-6, constant=60.0, growing=400.0)
    recording = late(late(recording, 0, 4e-3), 1, 4e-3)
    answer = asked(recording)
    for where in ("a1", "a2"):
        delay = of(answer, where)["channel_delay"]["delay_s"].estimate
        assert delay == pytest.approx(4e-3, rel=0.03)


def test_a_clock_of_its_own_is_named_where_only_one_axis_is_late():
    answer = asked(late(moved(), 1, 8e-3))
    assert not of(answer, "a1")
    delay = of(answer, "a2")["channel_delay"]["delay_s"].estimate
    assert delay == pytest.approx(8e-3, rel=0.02)


def test_a_long_delay_alone_explains_everything():
    recording = moved()
    answer = asked(late(late(recording, 0, 0.01), 1, 0.01))
    assert {n.effect for n in answer.named} == {"channel_delay"}
    assert answer.verdict == "explained"


def test_a_contact_that_slips_is_hysteresis_and_no_delay():
    recording = moved()
    pull = load(recording, 1)
    held, course = pull[0], []
    for i, torque in enumerate(pull):
        if i and recording.posture_id[i] != recording.posture_id[i - 1]:
            held = torque
        held = max(torque - 60.0, min(torque + 60.0, held))  # play of a torque
        course.append(held)
    recording = plus(recording, 1, -2e-6 * pull - 1e-6 * np.array(course))
    answer = asked(with_torque(recording, np.zeros_like(pull), pull))
    found = of(answer, "a2")
    assert set(found) == {"joint_compliance", "hysteresis"}
    width = found["hysteresis"]["width_rad"].estimate
    assert width == pytest.approx(2 * 1e-6 * 60.0, rel=0.1)


def test_a_torque_with_the_wrong_sign_is_said():
    recording = wound(moved(), 2.5e-6, constant=60.0, growing=250.0)
    assert recording.axis_torque is not None
    answer = asked(replace(recording, axis_torque=-recording.axis_torque))
    signs = [w.where for w in answer.warnings if w.code == "torque_sign"]
    assert signs == ["a2"] and "joint_compliance" not in of(answer, "a2")


def test_short_motions_at_a_high_rate_are_compared_too():
    """A tenth of a second, over which torques are smoothed, is longer than they are."""
    recording = wound(moved(3), 2.5e-6, constant=60.0, growing=250.0)
    recording = recording.take(np.flatnonzero(recording.time % 60.0 < 0.6))
    fast = replace(recording, time=recording.time / 10.0, load_time=recording.time)
    axes = heldout_comparison(fast, PLAIN)
    assert [a.name for a in axes] == ["a1", "a2"]
    assert all(np.isfinite(a.after).all() for a in axes)


def test_rows_that_share_their_time_count_once():
    recording = late(moved(3), 1, 8e-3)
    twice = recording.take(np.sort(np.r_[np.arange(len(recording.time)), 5, 900]))
    delay = of(asked(twice), "a2")["channel_delay"]["delay_s"].estimate
    assert delay == pytest.approx(8e-3, rel=0.02)


def test_a_slow_wave_has_its_own_order():
    recording = moved()
    recording = plus(recording, 1, 1e-4 * np.sin(2.0 * recording.posture[:, 1] + 0.4))
    wave = of(asked(recording), "a2")["transmission_error"]
    assert wave["order"].low <= 2.0 <= wave["order"].high < 5.0
    assert wave["amplitude_rad"].estimate == pytest.approx(1e-4, rel=0.3)


def test_a_spring_of_the_model_is_fitted_within_a_decade_and_no_finding(tmp_path):
    recording = still_first(moved())
    recording = plus(recording, 1, -3.0 / 4e5 * hanging(recording))
    model = heavy(tmp_path, spring=4e5)
    axes = heldout_comparison(recording, model)
    assert whole_rms(axes[0].after) < 1.1 * NOISE
    answer = answer_of("", axes, 0.0)
    assert answer.verdict == "no_mismatch" and answer.named == ()


def test_a_spring_of_the_model_that_is_not_there_is_a_mismatch(tmp_path):
    axes = heldout_comparison(still_first(moved()), heavy(tmp_path, spring=5e4))
    assert whole_rms(axes[0].after) < 1.1 * NOISE
    answer = answer_of("", axes, 0.0)
    assert answer.verdict == "explained"
    give = of(answer, "a2")["joint_compliance"]["compliance_rad_per_nm"]
    assert give.high < 0.01 / 5e4
    assert any(w.code == "spring" and w.where == "a2" for w in answer.warnings)


def compare_and_write(recording, model, folder):
    outcome = compare_encoders(recording, model)
    write_files(folder, outcome)


def test_what_was_named_is_left_as_a_patch_that_the_bench_loads(tmp_path):
    recording = wound(moved(), 2.5e-6, constant=60.0, growing=250.0)
    wave = 6e-5 * np.sin(97.0 * recording.posture[:, 1])
    compare_and_write(plus(recording, 1, wave), PLAIN, tmp_path / "out")
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert {"patch.json", "model.xml", "diagnosis.rrd"} <= names
    rig = patch.rig_of(patch.read(tmp_path / "out" / patch.FILE))
    assert rig.springs[1] == pytest.approx(1.0 / 2.5e-6, rel=0.02)
    assert [e.name for e in rig.effects] == ["transmission_error"]


def test_where_nothing_was_named_there_is_no_patch(tmp_path):
    compare_and_write(moved(), PLAIN, tmp_path / "out")
    names = {file.name for file in (tmp_path / "out").iterdir()}
    assert "patch.json" not in names and "diagnosis.rrd" in names
