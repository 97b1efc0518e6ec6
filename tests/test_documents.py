"""What the documents say is so: links, modules, commands, tables and code blocks."""

import importlib
import json
import re
import shlex
import subprocess
import sys
from pathlib import Path
from typing import get_args

import msgspec
import pytest
import tyro
from effect_table import COMMAND, README, tables, written
from source import ROOT, scenario_files

from bench import standard_plans
from scenarios.pipelines.schema import Answer, Verdict
from scenarios.report.summary import narrative

DOCUMENTS = [
    *("README.md", "bench/README.md", "stiffness/README.md", "scenarios/README.md"),
    *("mjcf/kr10_r1100_2/README.md", "mjcf/ur10/README.md"),
]
COMMANDS = tuple(Path(f).stem for f in scenario_files() if f.count("/") == 1)
PROGRAM = "python -m scenarios."
FIVE_MINUTES = 180
"""Lines of the first page; what is longer belongs to a package's own."""


def text(document: str) -> str:
    """Return a document's text."""
    return (ROOT / document).read_text("utf-8")


def blocks(document: str, language: str) -> list[str]:
    """Return the code blocks of a language."""
    return re.findall(rf"```{language}\n(.*?)```", text(document), re.DOTALL)


def commands(document: str) -> list[str]:
    """Return every command of ours with its flags: in blocks, tables and sentences."""
    code = "\n".join(blocks(document, "sh")).replace("\\\n", " ")
    prose = re.sub(r"```.*?```", "", text(document), flags=re.DOTALL)
    code += "\n" + "\n".join(
        s.replace("\n", " ") for s in re.findall("`([^`]+)`", prose)
    )
    known = "|".join(COMMANDS)
    found = re.findall(
        rf"^(?:{re.escape(PROGRAM)})?((?:{known}) .+)$", code, re.MULTILINE
    )
    return list(dict.fromkeys(line.partition(" #")[0].strip() for line in found))


def settings_of(command: str):
    """Return the module of a command, and its settings as its flags make them."""
    name, *flags = shlex.split(command)
    module = importlib.import_module(f"scenarios.{name}")
    return module, tyro.cli(module.Settings, args=flags)


EVERY = [(d, c) for d in DOCUMENTS for c in commands(d) if "--help" not in c]


def test_tables_of_effects_are_those_of_the_catalogue():
    text_of_today = written(README.read_text("utf-8"))
    assert text_of_today == tables(), f"run: {COMMAND}"


@pytest.mark.parametrize("document", DOCUMENTS)
def test_every_link_leads_to_a_file(document):
    links = re.findall(r"\]\(([^)#\s]+)\)", text(document))
    here = (ROOT / document).parent
    lost = [x for x in links if "://" not in x and not (here / x).exists()]
    assert lost == []


@pytest.mark.parametrize("document", DOCUMENTS[:4])
def test_every_module_that_is_named_exists(document):
    here = (ROOT / document).parent
    code = ("bench", "stiffness", "scenarios", "tests")
    every = [
        p.relative_to(ROOT).as_posix() for c in code for p in (ROOT / c).rglob("*.py")
    ]
    named = re.findall(r"`(?:…/)?((?:\w+/)*[a-z]\w*\.py)`", text(document))
    own = {"X.py", "my_method.py"}
    lost = [
        name
        for name in named
        if Path(name).name not in own
        and not (here / name).exists()
        and not any(f"/{file}".endswith(f"/{name}") for file in every)
    ]
    assert lost == []


@pytest.mark.parametrize(("document", "command"), EVERY, ids=lambda v: v.split()[0])
def test_every_command_takes_the_flags_that_are_written(document, command):
    module, settings = settings_of(command)
    assert isinstance(settings, module.Settings)


def test_every_command_stands_in_the_list_of_commands():
    listed = {command.split()[0] for command in commands("scenarios/README.md")}
    assert listed == set(COMMANDS)


@pytest.mark.parametrize("document", ["README.md", "stiffness/README.md"])
def test_each_verdict_is_explained_and_no_other(document):
    _, table = text(document).split("| verdict |")
    rows = re.findall(r"^\| `(\w+)` \|", table.partition("\n\n")[0], re.MULTILINE)
    assert sorted(rows) == sorted(get_args(Verdict))


def test_first_page_can_be_read_in_five_minutes():
    assert len(text("README.md").splitlines()) <= FIVE_MINUTES


def test_numbers_of_trials_on_the_first_page_are_those_of_the_results():
    def bars(of: str) -> dict[str, dict]:
        file = ROOT / "results" / "blind_trials" / of / "summary.json"
        return {bar["what"]: bar for bar in json.loads(file.read_text("utf-8"))["bars"]}

    def good(of: str, *names: str) -> str:
        known = [bars(of)[name] for name in names]
        return f"{sum(b['successes'] for b in known):,} of " + (
            f"{sum(b['trials'] for b in known):,}"
        )

    arms = [good(of, "right: one_100", "right: one_400") for of in
            ("six", "seven", "column")]  # fmt: skip
    hits, trials = (sum(int(a.split()[k]) for a in arms) for k in (0, 2))
    outside = "whole arms with a mechanism outside"
    held = "intervals that hold their parameter"
    said = {
        good("", "detected: null and null_nuisance"),
        good("", "right: one_100"),
        good("", "right: one_400"),
        good("", "right: flange_400"),
        good("", "whole set: two_400"),
        good("", held),
        f"{hits} of {trials}",
        good("strangers", "told apart: memory", "declared: memory_blind"),
        good("beside_unknown", f"places outside the vocabulary said: {outside}"),
        good("beside_unknown", f"names that are false: {outside}"),
        good("beside_unknown", f"right names lost by it: {outside}"),
        good("beside_unknown", "names that are false: whole arms"),
        good("whole", "names that are false: whole arms"),
        good("whole", f"{held}: whole arms"),
    }
    page = " ".join(text("README.md").split())
    assert sorted(number for number in said if number not in page) == []


def test_answer_on_the_first_page_is_that_of_the_result():
    file = ROOT / "results" / "diagnosis" / "diagnosis.json"
    answer = msgspec.json.decode(file.read_bytes(), type=Answer)
    told = " ".join(narrative(answer))
    [shown] = [b for b in blocks("README.md", "text") if "Proof:" in b]
    parts = [part.strip() for part in " ".join(shown.split()).split("…")]
    assert [part for part in parts if part not in told] == []
    [proof] = [line for line in narrative(answer) if line.startswith("Proof:")]
    assert proof in parts[-1]


@pytest.mark.slow
def test_quickstart_works_word_for_word(tmp_path, monkeypatch):
    (tmp_path / "mjcf").symlink_to(ROOT / "mjcf")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(ROOT))
    [quickstart] = [b for b in blocks("README.md", "sh") if "import_recording" in b]
    lines = quickstart.replace("\\\n", " ").splitlines()
    ours = [line.removeprefix(PROGRAM) for line in lines if PROGRAM in line]
    for command in ours:  # each in a process of its own, as a reader does
        name, *flags = shlex.split(command)
        program = [sys.executable, "-m", f"scenarios.{name}", *flags]
        done = subprocess.run(program, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
    assert [c.split()[0] for c in ours][-2:] == ["check", "diagnose"]
    answer = json.loads(Path("my-answer", "diagnosis.json").read_text("utf-8"))
    assert answer["verdict"] == "explained"
    assert [(n["effect"], n["where"]) for n in answer["named"]] == [
        ("hysteresis", "a2")
    ]
    assert answer["explained_share"]["low"] > 0.5
    for file in ("report.html", "model.xml", "patch.json"):
        assert Path("my-answer", file).is_file()


def test_python_of_the_first_page_is_that_of_the_example():
    """Which runs in a test of its own, with the same numbers."""
    [code] = blocks("README.md", "python")
    lines = [line.partition("  #")[0] for line in code.splitlines() if line]
    example = text("scenarios/examples/first_diagnosis.py").splitlines()
    assert [line for line in lines if line not in example] == []


@pytest.mark.slow
def test_experiment_of_the_benchs_document_runs(monkeypatch, capsys):
    """With fewer poses than the document's."""
    [experiment] = blocks("bench/README.md", "python")
    plan = standard_plans.table_one_plan
    monkeypatch.setattr(standard_plans, "table_one_plan", lambda: plan(poses=20))
    monkeypatch.chdir(ROOT)
    exec(experiment, {})
    springs = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [spring[0] for spring in springs] == [f"a{k}" for k in range(1, 7)]
