"""An answer is written whole: made beside its folder and moved there file by file."""

import os
import shutil
from collections.abc import Sequence
from pathlib import Path
from tempfile import mkdtemp

from scenarios.diagnosing import answer as form
from scenarios.diagnosing.schema import Answer
from scenarios.reporting import page
from scenarios.two_encoders.compared import Axis
from scenarios.two_encoders.report import blocks_of, first_sentence


def written(folder: Path, axes: Sequence[Axis], answer: Answer) -> None:
    """Write diagnosis.json, pictures and the report."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    waiting = Path(mkdtemp(prefix=".two-encoders-", dir=folder.parent))
    try:
        blocks = blocks_of(axes, answer, waiting)
        title = f"Two encoders an axis: {answer.recording}"
        page.write(waiting, title, first_sentence(axes, answer), blocks)
        text = form.text_of(answer)
        (waiting / "diagnosis.json").write_text(text, encoding="utf-8")
        folder.mkdir(exist_ok=True)
        for file in sorted(waiting.iterdir()):
            os.replace(file, folder / file.name)
    finally:
        shutil.rmtree(waiting, ignore_errors=True)
