import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")
OUTER = ("MAKEFLAGS", "MAKEOVERRIDES", "MAKELEVEL")
"""Variables that `make test` passes on to the make of a test."""
needed = pytest.mark.skipif(
    not sys.platform.startswith("linux") or shutil.which("make") is None,
    reason="a Linux with make",
)


@pytest.fixture
def view(tmp_path):
    """A recording, and a viewer that only prints what it would open."""
    program = tmp_path / "bin" / "rerun"
    program.parent.mkdir()
    program.write_text('#!/bin/sh\necho "opened $1"\n')
    program.chmod(0o755)
    (tmp_path / ".installed").touch()
    (tmp_path / "study.rrd").touch()

    def run(**screens: str) -> subprocess.CompletedProcess:
        bare = {k: v for k, v in os.environ.items() if k not in SCREENS + OUTER}
        places = [f"VENV={tmp_path}", f"STUDY={tmp_path}"]
        words = ["make", "--silent", "view", *places]
        return subprocess.run(
            words,
            cwd=ROOT,
            env=bare | screens,
            capture_output=True,
            text=True,
            check=False,
        )

    return run


@needed
@pytest.mark.parametrize("screen", SCREENS)
def test_a_recording_is_opened_where_there_is_a_screen(view, tmp_path, screen):
    done = view(**{screen: "0"})
    assert (done.returncode, done.stdout) == (0, f"opened {tmp_path}/study.rrd\n")


@needed
def test_without_a_screen_it_is_said_where_to_open_the_recording(view, tmp_path):
    done = view()
    assert done.returncode == 2 and not done.stdout
    assert f"no display here. Copy {tmp_path}/study.rrd" in done.stderr
    assert "pip install rerun-sdk==" in done.stderr


@needed
def test_without_a_recording_it_is_said_how_to_make_one(view, tmp_path):
    (tmp_path / "study.rrd").unlink()
    done = view(DISPLAY=":0")
    assert done.returncode == 2 and "No recording yet: make study" in done.stderr
