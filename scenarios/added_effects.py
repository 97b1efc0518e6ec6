"""Is an effect of known size found where it is added to the readings of real arms?

Real noise, and all that a real arm does, with a truth that is known: to a UR10's target
are added what MuJoCo says that an effect moves it, to a KR300's second encoder what an
effect would make of it. The same tools as for the arms as they are then say what is
there; what they say more than before is compared with what was added.

Run:    python -m scenarios.added_effects --ur10 FOLDER --kr300 FOLDER
Takes:  a minute for the KR300; the UR10 is calibrated eight times, 3 minutes
Expect: a table for each arm, added.csv beside its report
"""

from dataclasses import dataclass
from pathlib import Path

from scenarios.report.command_line import run


@dataclass(frozen=True)
class Settings:
    """What to read, and where results go."""

    ur10: Path | None = None
    """Folder of the UR10's series; none: it is left out."""
    kr300: Path | None = None
    """Folder of the KR300's series; none: it is left out."""
    out: Path = Path("results")
    """Folder that holds real_ur10 and real_kr300."""


def main(settings: Settings) -> list[dict[str, object]]:
    """Add, look, and write what was found."""
    from scenarios.pipelines.inputs import arm_of
    from scenarios.studies import added_effects, public_recordings
    from stiffness.calibration.model import readings_of

    found: list[dict[str, object]] = []
    if settings.kr300 is not None:
        recording = public_recordings.kr300_recording(settings.kr300)
        found += _written(
            settings.out / "real_kr300", added_effects.kr300_rows(recording)
        )
    if settings.ur10 is not None:
        recording = public_recordings.ur10_recording(settings.ur10)
        arm = arm_of(public_recordings.MODEL).for_recording(recording)
        base = added_effects.base_of(readings_of(recording, arm))
        rows = added_effects.ur10_rows(base, public_recordings.MODEL)
        found += _written(settings.out / "real_ur10", rows)
    return found


def _written(folder: Path, rows) -> list[dict[str, object]]:
    from scenarios.report import data_files

    found = []
    folder.mkdir(parents=True, exist_ok=True)
    partial = folder / ".added.csv"
    for row in rows:
        found.append(row)
        print("  ".join(f"{k}={_text(v)}" for k, v in row.items()), flush=True)
        data_files.write_table(partial, found)
    partial.replace(folder / "added.csv")
    return found


def _text(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    run(main, Settings)
