import json

import numpy as np
import pytest

from bench.effects import EFFECTS
from bench.shared.errors import BenchError, Unusable
from bench.shared.format import folder
from scenarios import record as scenario
from scenarios.pipelines.synthetic_recording import Watching
from scenarios.record import Settings, main
from scenarios.report.command_line import run

SHORT = "0,10,0"


def small(out, **more):
    return Settings(out=out, **({"poses": 12, "path": SHORT} | more))


def on_the_command_line(monkeypatch, *words):
    monkeypatch.setattr("sys.argv", ["record", *map(str, words)])
    run(main, Settings)


def test_one_command_makes_a_whole_recording(tmp_path, capsys):
    main(small(tmp_path / "r", effect=("hysteresis@a2,width_rad=2e-4",)))
    recording, notes = folder.read(tmp_path / "r")
    assert notes == ()
    assert recording.points is not None
    assert recording.points.shape == (36, 28, 3)
    assert sorted(p.name for p in (tmp_path / "r").iterdir()) == [
        "recording.toml",
        "samples.csv",
    ]
    assert "36 rows, 28 markers" in capsys.readouterr().out


def test_same_command_writes_the_same_bytes(tmp_path):
    for name in ("one", "two"):
        main(small(tmp_path / name, seed=7, effect=("creep@a2",)))
    for file in ("samples.csv", "recording.toml"):
        one, two = ((tmp_path / n / file).read_bytes() for n in ("one", "two"))
        assert one == two


def test_effect_shows_in_the_recording(tmp_path):
    quiet = Watching(noise_mm=(0.0,), wrench_noise=0.0)
    seen = [
        main(small(tmp_path / "r", watch=quiet, effect=words)).points
        for words in ((), ("base_compliance@base",))
    ]
    assert np.abs(np.diff(np.array(seen, float), axis=0)).max() > 1e-6


def test_truth_is_written_beside_and_never_inside(tmp_path):
    truth_file = tmp_path / "truth.json"
    words = ("lost_motion@a3,width_rad=3e-4", "wrench_bias@wrench_sensor,fz_n=2")
    settings = small(tmp_path / "r", effect=words, truth_file=truth_file, seed=3)
    main(settings)
    truth = json.loads(truth_file.read_text())
    assert [(e["effect"], e["where"]) for e in truth["effects"]] == [
        ("lost_motion", "a3"),
        ("wrench_bias", "wrench_sensor"),
    ]
    assert truth["effects"][0]["parameters"]["width_rad"] == 3e-4
    assert truth["effects"][1]["parameters"]["fz_n"] == 2.0
    assert truth["seed"] == 3
    assert truth["stiffness"]["a2"] == 63360.0  # Table 3 of Wu et al. 2024
    written = "".join(p.read_text() for p in (tmp_path / "r").iterdir())
    for secret in ("lost_motion", "wrench_bias", "stiffness"):
        assert secret not in written
    assert sorted(p.name for p in tmp_path.iterdir()) == ["r", "truth.json"]


@pytest.mark.parametrize("inside", ["r/truth.json", "r/deeper/t.json", "other/../r/t"])
def test_truth_file_inside_the_recording_ends_with_2(
    inside, tmp_path, monkeypatch, capsys
):
    with pytest.raises(SystemExit) as end:
        on_the_command_line(
            monkeypatch, "--out", tmp_path / "r", "--truth-file", tmp_path / inside
        )
    assert end.value.code == 2
    assert "a recording holds no truth" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_truth_file_behind_a_link_into_the_recording_is_refused(tmp_path):
    (tmp_path / "r").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "r")
    with pytest.raises(Unusable, match="lies inside"):
        main(small(tmp_path / "r", truth_file=tmp_path / "link" / "t.json"))


def test_truth_file_that_is_a_loop_of_links_is_refused(tmp_path):
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(Unusable, match="it is there and is no file"):
        main(small(tmp_path / "r", truth_file=tmp_path / "a"))


@pytest.mark.parametrize(
    ("setting", "says"),
    [
        ({"effect": ("pulley_friction@rig,ratio=1",)}, "at least 0.0 and at most 0.5"),
        ({"effect": ("creep@a2,ratio=1e9",)}, "at least 0.0 and at most 10.0"),
        ({"effect": ("hysteresis@a2,elements=1e9",)}, "at least 1 and at most 100"),
        ({"effect": ("joint_compliance@a2,compliance_rad_per_nm=5e-3",)}, "a2 ends"),
        ({"watch": Watching(direction_deg=1e300)}, "turn is .*at most 1e"),
        ({"watch": Watching(noise_mm=(1e300,))}, "repeatability is .*at most 1e"),
    ],
)
def test_what_no_arm_and_no_instrument_can_be_is_refused(tmp_path, setting, says):
    with pytest.raises(BenchError, match=says):
        main(small(tmp_path / "r", **setting))
    assert list(tmp_path.iterdir()) == []


def test_unknown_effect_ends_with_2_and_the_nearest_name(tmp_path, monkeypatch, capsys):
    with pytest.raises(SystemExit) as end:
        on_the_command_line(
            monkeypatch, "--effect", "hysteresys@a2", "--out", tmp_path / "r"
        )
    assert end.value.code == 2
    assert "Did you mean 'hysteresis'" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_all_mistakes_of_a_command_are_named_at_once(tmp_path):
    wrong = small(
        tmp_path / "r",
        effect=("creep@b2", "nothing@a1"),
        stiffness_scale=(1.0, -1.0),
        path="5,10",
        seed=-1,
        poses=0,
        watch=Watching(noise_mm=(0.0, 1.0)),
        truth_file=tmp_path / "r" / "t.json",
    )
    with pytest.raises(Unusable) as error:
        main(wrong)
    said = str(error.value)
    for word in ("b2", "nothing", "-1.0", "5 kg", "--seed", "--poses", "--noise-mm"):
        assert word in said
    assert len(error.value.faults) == 8
    assert list(tmp_path.iterdir()) == []


def test_marker_that_does_not_exist_is_refused(tmp_path, monkeypatch, capsys):
    with pytest.raises(SystemExit) as end:
        words = ("--effect", "marker_slip@marker:link2_x", "--out", tmp_path / "r")
        on_the_command_line(monkeypatch, *words)
    assert end.value.code == 2
    assert "No marker is called 'link2_x'" in capsys.readouterr().err


def test_recording_that_is_there_is_replaced_and_nothing_else(tmp_path):
    main(small(tmp_path / "r", seed=1))
    before = (tmp_path / "r" / "samples.csv").read_bytes()
    main(small(tmp_path / "r", seed=2))
    assert (tmp_path / "r" / "samples.csv").read_bytes() != before
    (tmp_path / "r" / "notes.txt").write_text("mine")
    with pytest.raises(Unusable, match=r"notes\.txt"):
        main(small(tmp_path / "r", seed=3, truth_file=tmp_path / "t.json"))
    assert not (tmp_path / "t.json").exists()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["r"]


def test_default_truth_has_springs_and_effects_of_its_own(tmp_path):
    truth_file = tmp_path / "t.json"
    main(small(tmp_path / "r", truth="default", truth_file=truth_file, poses=2))
    truth = json.loads(truth_file.read_text())
    assert {e["effect"] for e in truth["effects"]} >= {"hardening", "hysteresis"}
    assert truth["stiffness"]["a2"] != 63360.0


def test_another_arm_goes_through_its_own_range_of_motion(tmp_path, root):
    ur10 = root / "mjcf" / "ur10" / "ur10.xml"
    soft = ("joint_compliance@a2", "joint_compliance@a3")
    recording = main(small(tmp_path / "r", robot=ur10, effect=soft))
    assert recording.robot == "ur10"
    assert len(np.unique(recording.posture_id)) == 12
    with pytest.raises(Unusable, match="KR10"):
        main(small(tmp_path / "q", robot=ur10, truth="default"))


RIGID = ("hysteresis@a3,width_rad=1e-4", "creep@a2", "joint_compliance@a3")


def test_effects_that_move_nothing_are_refused_at_once_and_say_why(tmp_path, root):
    """A rigid gear does not wind up, so nothing slips or creeps in it."""
    ur10 = root / "mjcf" / "ur10" / "ur10.xml"
    with pytest.raises(Unusable, match="less than 1% of the noise of 10 µm") as error:
        main(small(tmp_path / "r", robot=ur10, effect=RIGID))
    named = [fault.partition(" ")[0] for fault in error.value.faults]
    assert named == ["hysteresis@a3", "creep@a2"]
    assert str(error.value).count("--stiffness, such as 5e4") == 2
    assert list(tmp_path.iterdir()) == []
    main(small(tmp_path / "r", robot=ur10, effect=RIGID, stiffness=(5e4,)))


def test_effects_too_small_for_the_noise_are_refused(tmp_path):
    words = ("hysteresis@a2,width_rad=1e-9", "wrench_bias@wrench_sensor,fx_n=1e-4")
    with pytest.raises(Unusable, match=r"0\.0001 N and 0 N m rms") as error:
        main(small(tmp_path / "r", effect=words))
    assert len(error.value.faults) == 2 and "make it larger" in str(error.value)
    finer = Watching(noise_mm=(1e-5,))
    main(small(tmp_path / "r", effect=("hysteresis@a2,width_rad=1e-7",), watch=finer))


def test_coupling_of_rigid_axes_is_refused_with_the_way_out(tmp_path, root):
    ur10 = root / "mjcf" / "ur10" / "ur10.xml"
    with pytest.raises(Unusable, match=r"a6 have no joint stiffness .* --stiffness"):
        main(small(tmp_path / "r", robot=ur10, effect=("wrist_coupling@a5",)))


def test_what_each_effect_moves_is_printed(tmp_path, capsys):
    words = ("hysteresis@a2,width_rad=2e-4", "wrench_bias@wrench_sensor,fx_n=0.25")
    main(small(tmp_path / "r", effect=words))
    rows = {}
    for line in capsys.readouterr().out.splitlines():
        name, *cells = (cell.strip() for cell in line.strip("│").split("│"))
        rows[name] = cells
    assert 5 < float(rows["hysteresis@a2"][0]) < 100
    assert rows["wrench_bias@wrench_sensor"] == ["0", "0.25", "0"]
    assert rows["noise of a reading, one sigma"] == ["10", "0.04", "0.002"]


def test_load_beyond_the_payload_is_refused_unless_asked_for(tmp_path, capsys):
    with pytest.raises(Unusable, match=r"up to 12 kg .* carries 10 kg.* --overload"):
        main(small(tmp_path / "r", path="0,12,0"))
    main(small(tmp_path / "r", path="0,12,0", overload=True))
    assert "up to 12 kg, not checked" in capsys.readouterr().out


def test_usual_loads_of_a_small_arm_are_within_its_payload(tmp_path, root, capsys):
    model = (root / "mjcf" / "ur10" / "ur10.xml").read_text()
    weak = tmp_path / "weak.xml"
    weak.write_text(model.replace('data="10"', 'data="3"'))
    recording = main(Settings(tmp_path / "r", robot=weak, poses=3))
    assert recording.load_mass is not None
    assert recording.load_mass.max() == 3.0
    assert "up to 3 kg in place of the usual 10 kg" in capsys.readouterr().out


def test_springs_of_the_default_truth_are_its_own(tmp_path):
    with pytest.raises(Unusable, match="no --stiffness"):
        main(small(tmp_path / "r", truth="default", stiffness=(5e4,)))
    with pytest.raises(Unusable, match="expected one number or 6, all above 0"):
        main(small(tmp_path / "r", stiffness=(5e4, -1.0)))


def test_list_of_effects_has_places_parameters_units_and_ranges(monkeypatch, capsys):
    with pytest.raises(SystemExit) as end:
        on_the_command_line(monkeypatch, "--effects")
    assert end.value.code == 0
    said = " ".join(capsys.readouterr().out.split())
    for kind in EFFECTS:
        assert f"{kind.name} @" in said
    assert "hysteresis @ a1 to a6" in said
    assert "width_rad 0.00015 rad 0 to 0.000291 (Harmonic Drive" in said
    assert "rx_rad_per_nm 5e-07 rad/(N m) 1e-07 to 1e-06" in said


def test_command_without_a_folder_ends_with_2(monkeypatch, capsys):
    with pytest.raises(SystemExit) as end:
        on_the_command_line(monkeypatch, "--poses", 3)
    assert end.value.code == 2
    assert "--out is missing" in capsys.readouterr().err


def test_manual_names_every_flag_that_stays(monkeypatch, capsys):
    with pytest.raises(SystemExit) as end:
        on_the_command_line(monkeypatch, "--help")
    assert end.value.code == 0
    manual = capsys.readouterr().out
    for flag in ("effect", "robot", "poses", "targets", "path", "seed", "truth-file"):
        assert f"--{flag}" in manual
    assert "--out" in manual and "--truth" in manual
    assert str(scenario.__doc__).splitlines()[0] in manual
