import base64
import html.parser
import json
import re
from datetime import date
from importlib import import_module
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure as Picture

from scenarios.report import command_line, data_files, figures, page
from scenarios.report.command_line import progress_bar
from scenarios.report.page import Figure, Heading, Paragraph, Table

NASTY = '<script>alert("x")</script> & <img src=x onerror=y> "\' {{ 7 * 7 }}'
"""What a stranger may call a marker, a method or a recording."""


class Elements(html.parser.HTMLParser):
    """What a browser would make of a page."""

    def __init__(self, text):
        """Take a page apart."""
        super().__init__()
        self.names, self.attributes, self.said = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        """Keep an element's name and attributes."""
        self.names.append(tag)
        self.attributes += [(tag, name, value) for name, value in attrs]

    def handle_data(self, data):
        """Keep what is said between elements."""
        self.said.append(data)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with one figure."""
    folder = tmp_path_factory.mktemp("report")
    picture = Picture(figsize=(2, 1))
    picture.subplots().plot([0, 1], [1, 0])
    figures.save(picture, folder / "one.png")
    return folder


def rendered(folder, text):
    """Write a report that says a text wherever one can be said."""
    blocks = [
        Heading(text),
        Paragraph(text),
        Table(text, (text, "b"), [(text, "1"), ("c", text)]),
        Figure(text, "one.png"),
    ]
    page.write(folder, text, text, blocks)
    return (folder / "report.md").read_text(), (folder / "report.html").read_text()


# --- Pages ---------------------------------------------------------------------------


def test_text_stays_text_in_html_wherever_it_stands(folder):
    _, plain = rendered(folder, "plain")
    _, nasty = rendered(folder, NASTY)
    ours, theirs = Elements(nasty), Elements(plain)
    assert ours.names == theirs.names  # not one element more
    keys = [[(tag, name) for tag, name, _ in e.attributes] for e in (ours, theirs)]
    assert keys[0] == keys[1]
    assert ours.said.count(NASTY) == theirs.said.count("plain") == 10
    assert ("img", "alt", NASTY) in ours.attributes


@pytest.mark.parametrize("block", [Heading, Paragraph])
def test_text_stays_text_in_markdown(folder, block):
    """Renderers of Markdown let HTML through, and a link hides where it leads."""
    page.write(folder, NASTY, NASTY, [block("<b>bold</b> [here](javascript:x)")])
    text = (folder / "report.md").read_text()
    assert "<script>" not in text
    assert "<b>" not in text
    assert not re.search(r"(?<!\\)\]\(", text)


def test_bar_in_a_cell_makes_no_column_in_markdown(folder):
    page.write(folder, "t", "s", [Table("c", ("a", "b"), [("one|two\nthree", "4")])])
    lines = (folder / "report.md").read_text().splitlines()
    row = lines[lines.index("| a | b |") + 2]
    assert len(re.findall(r"(?<!\\)\|", row)) == 3
    assert row.endswith("| 4 |")


def test_pictures_are_inside_the_html_and_beside_the_markdown(folder):
    markdown, page_text = rendered(folder, "a caption")
    assert "![a caption](one.png)" in markdown
    sources = [
        v for t, n, v in Elements(page_text).attributes if (t, n) == ("img", "src")
    ]
    data = sources[0].removeprefix("data:image/png;base64,")
    assert base64.b64decode(data, validate=True) == (folder / "one.png").read_bytes()
    assert not re.search(r"""(?:src|href)=["'](?!data:)""", page_text)  # one file


def test_blocks_keep_their_order_in_both_renderings(folder):
    page.write(folder, "title", "summary", [Paragraph(f"part {k}") for k in range(5)])
    for name in ("report.md", "report.html"):
        text = (folder / name).read_text()
        places = [text.index(word) for word in ("title", "summary", "part 0", "part 4")]
        assert places == sorted(places)


def test_table_in_markdown_has_a_cell_for_each_value(folder):
    shown = Table("caption", ("a", "b"), [("1", "2"), ("3", "4")])
    page.write(folder, "t", "s", [shown])
    lines = (folder / "report.md").read_text().splitlines()
    start = lines.index("| a | b |")
    assert lines[start + 1] == "|---|---|"
    assert lines[start + 2 : start + 4] == ["| 1 | 2 |", "| 3 | 4 |"]


def test_missing_picture_is_an_error_and_no_hole(folder):
    with pytest.raises(FileNotFoundError):
        page.write(folder, "t", "s", [Figure("caption", "none.png")])


def test_same_figure_is_the_same_bytes(tmp_path):
    for name in ("one.png", "two.png"):
        picture = Picture(figsize=(2, 1))
        picture.subplots().plot([0, 1, 2], [2, 0, 1], color=figures.ORANGE)
        figures.save(picture, tmp_path / name)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()


# --- Tables --------------------------------------------------------------------------

words = st.text("ab 1,;\"'|\n\té–∗", max_size=12)
rows = st.lists(
    st.fixed_dictionaries({"name": words, "count": st.integers(), "note": words}),
    min_size=1,
    max_size=5,
)


@given(rows)
def test_table_reads_back_as_it_was_written(folder, rows):
    """Commas, quotes and line ends included."""
    file = folder / "t.csv"
    data_files.write_table(file, rows)
    assert data_files.read_table(file) == [
        {k: str(v) for k, v in row.items()} for row in rows
    ]


@given(st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=False))
def test_number_keeps_seven_digits(folder, value):
    file = folder / "x.csv"
    data_files.write_table(file, [{"x": value}])
    read = float(data_files.read_table(file)[0]["x"])
    assert read == pytest.approx(value, rel=5.1e-7, abs=0)


def test_value_that_is_missing_is_an_empty_cell(tmp_path):
    data_files.write_table(tmp_path / "t.csv", [{"a": None, "b": 1.0}])
    assert (tmp_path / "t.csv").read_text() == "a,b\n,1\n"


# --- How it was made -----------------------------------------------------------------


def test_run_file_says_command_settings_versions_and_facts(tmp_path):
    settings = {"out": tmp_path, "seed": 3, "day": date(2024, 1, 1)}
    data_files.write_run_file(tmp_path, "python -m scenarios.x", settings, rows=7)
    run = json.loads((tmp_path / "run.json").read_text())
    assert (run["command"], run["rows"]) == ("python -m scenarios.x", 7)
    assert run["settings"] == {"out": str(tmp_path), "seed": 3, "day": "2024-01-01"}
    assert run["libraries"].keys() == set(data_files.LIBRARIES)
    assert all(re.match(r"\d+\.\d+", v) for v in run["libraries"].values())


@pytest.mark.parametrize("ends", [(0.002, 0.03), (0.4, 3.0), (1e-4, 100.0)])
def test_decades_are_told_in_plain_numbers_that_do_not_touch(ends):
    figure = Picture(figsize=(3, 3), layout="constrained")
    axes = figure.subplots()
    axes.set(xscale="log", xlim=ends)
    figures.plain_log(axes.xaxis)
    FigureCanvasAgg(figure).draw()
    low, high = ends
    said = [t for t in axes.get_xticklabels() if low <= float(t.get_text()) <= high]
    assert len(said) > 1
    boxes = [t.get_window_extent() for t in said]
    assert all(a.x1 < b.x0 for a, b in pairwise(boxes))


def test_numbers_stand_at_the_right_and_words_at_the_left(tmp_path):
    rows = [
        ["a1", "-1.5 µrad (-2 to -1)", "may be chance", ""],
        ["a2", "–", "9 poses\N{EM DASH}no", ""],
    ]
    shown = Table(
        "Some.", ["axis", "size", "why", "none"], [*rows, ["a3", "", "x", ""]]
    )
    page.write(tmp_path, "Title", "Summary.", [shown])
    text = (tmp_path / "report.html").read_text()
    sides = re.findall(r'<th class="(\w+)">', text)
    assert sides == ["left", "right", "left", "left"]
    assert re.findall(r'<td class="(\w+)">', text) == 3 * sides


@pytest.mark.parametrize("name", command_line.commands())
def test_no_manual_shows_a_type_of_python(name, monkeypatch, capsys):
    command = import_module(f"scenarios.{name}")
    monkeypatch.setattr("sys.argv", [name, "--help"])
    with pytest.raises(SystemExit, match="0"):
        command_line.run(command.main, command.Settings, name)
    said = capsys.readouterr().out
    assert "usage:" in said and "None" not in said


def test_without_a_terminal_a_bar_is_a_line_now_and_then(capfd, monkeypatch):
    with progress_bar() as progress:
        assert list(progress.track([1, 2, 3])) == [1, 2, 3]
    assert capfd.readouterr() == ("", "")
    monkeypatch.setattr(command_line, "EVERY_S", 0.0)
    with progress_bar() as progress:
        task = progress.add_task("asking", total=3)
        progress.advance(task, 2)
    assert capfd.readouterr() == ("", "asking: 2 of 3\n")
