"""The recordings and commands whose results are compared.

A case has a folder of its own and one step a line: a command of the tree, without
`python -m scenarios.`, or one of `STEPS`, which know the recording format and nothing
of the tree. `{tree}` is the tree's root, `{real}` the folder of real recordings. With a
`*` in a word, the command is run for each file that it matches, called `{name}`.
"""

import csv
import os
import re
from pathlib import Path

import numpy as np

KR10 = "--robot {tree}/mjcf/kr10_r1100_2/kr10_r1100_2.xml"
UR10 = "--robot {tree}/mjcf/ur10/ur10.xml"
HINGES = "--robot {tree}/mjcf/six_hinges/six_hinges.xml"
TWO = "--effect hysteresis@a2,width_rad=1.2e-4 --effect bearing_tilt@a3"
SOFT = (
    "--effect encoder_offset@a3,offset_rad=6e-4"
    " --effect transmission_error@a2,amplitude_rad=2e-4,order=7,phase_rad=0.4"
    " --effect joint_compliance@a2,compliance_rad_per_nm=2e-5"
)
PLAY = "--effect lost_motion@a3,width_rad=3e-4 --effect link_bending@link_2"
BLIND = "blind_trials --trials 1 --seed 3 --poses 40 --keep --jobs 1 --out trials"
EACH = "diagnose trials/recordings/* --out answers/{name}"
DIAGNOSE = f"diagnose recording {KR10} --out answer"


def mistake(columns: str, factor: float) -> str:
    """Return a case of no effect, where columns of the recording are multiplied."""
    return f"""record --poses 30 --path 0,10,0 --out recording
        multiply {columns} {factor}
        check recording {KR10}
        {DIAGNOSE}"""


QUICK = {
    "two_effects": f"record --poses 40 {TWO} --out recording\n{DIAGNOSE}",
    "nothing": f"record --poses 40 --out recording\n{DIAGNOSE}",
    "flange_alone": f"""record --poses 60 --targets flange {PLAY} --out recording
        {DIAGNOSE}""",
    "axis_reversed": mistake("a5_deg", -1.0),
    "calibration": f"""
        record {UR10} --path 0 --targets flange --poses 240 {SOFT} --out recording
        calibrate recording {UR10} --out answer""",
    "two_encoders": f"stream\ndiagnose recording {HINGES} --out answer",
}
ALL = QUICK | {
    "wrench_reversed": mistake("[ft][xyz]_nm?", -1.0),
    "markers_mirrored": mistake(".*_y_mm", -1.0),
    "markers_in_metres": mistake(".*_[xyz]_mm", 1e-3),
    "make_diagnosis": f"""record {TWO} --truth-file truth.json --out recording
        check recording {KR10}
        {DIAGNOSE}""",
    "blind_trials": f"{BLIND} --proof\n{EACH} {KR10}",
    "blind_seven": f"""{BLIND} --arm seven --strata two_400
        {EACH} --robot trials/models/seven_3.xml""",
    "blind_column": f"""{BLIND} --arm column --strata two_400
        {EACH} --robot trials/models/column_3.xml""",
    "study": "study --budget tiny --poses 40 --seed 4 --jobs 1 --out answer",
}
REAL = {
    "real_kr300": "real_kr300 --data {real}/kr300-two-encoders --out answer",
    "real_ur10": "real_ur10 --data {real}/ur10-leica --draws 0 --out answer",
}


def chosen(cases: str) -> dict[str, list[str]]:
    """Return the steps of `quick` or `all`, real recordings where there are any."""
    everything = ALL | REAL if os.environ.get("REAL_RECORDINGS") else ALL
    texts = QUICK if cases == "quick" else everything
    return {name: text.strip().splitlines() for name, text in texts.items()}


def multiply(folder: Path, columns: str, factor: str) -> None:
    """Make a mistake in a recording: multiply the columns whose name matches."""
    file = folder / "recording" / "samples.csv"
    with file.open(encoding="utf-8", newline="") as source:
        header, *rows = csv.reader(source)
    for k, name in enumerate(header):
        for row in rows:
            if re.fullmatch(columns, name) and row[k]:
                row[k] = repr(float(row[k]) * float(factor))
    _write(file, [header, *rows])


def stream(folder: Path) -> None:
    """Write three motions in which the gear of a2, read twice, lags and winds up."""
    random = np.random.default_rng(7)
    time, motion = np.tile(np.arange(0.0, 8.0, 0.004), 3), np.repeat(range(3), 2000)
    rate, phase, swing = (
        random.uniform(low, high, (3, 4))[motion]
        for low, high in ((0.6, 2.2), (0.0, 6.0), (0.05, 0.25))
    )
    now, late = (
        np.sum(swing * np.sin(rate * when[:, None] + phase), axis=1)
        for when in (time, time - 0.004)
    )
    torque = 900.0 * np.cos(now + 0.4)
    link = late - 4e-7 * torque + random.normal(0.0, 5e-6, len(time))
    table = np.zeros((len(time), 10))
    table[:, 0], table[:, 1], table[:, 9] = time + 60.0 * motion, motion, torque
    table[:, 3], table[:, 8] = np.degrees(now), np.degrees(link)
    angles = [f"a{k}_deg" for k in range(1, 7)]
    rows = [["time_s", "pose", *angles, "a2_link_deg", "a2_tau_nm"], *table.tolist()]
    (folder / "recording").mkdir()
    manifest = 'format = 1\nname = "a gear read twice"\nrows = "stream"\n'
    (folder / "recording" / "recording.toml").write_text(manifest, encoding="utf-8")
    _write(folder / "recording" / "samples.csv", rows)


def _write(file: Path, rows: list) -> None:
    with file.open("w", encoding="utf-8", newline="") as target:
        csv.writer(target, lineterminator="\n").writerows(rows)


STEPS = {"multiply": multiply, "stream": stream}
