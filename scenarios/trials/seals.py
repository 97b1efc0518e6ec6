"""A hash that was published binds whoever published it."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path

from bench.errors import Unusable

ROOT = Path(__file__).parents[2]


def opened(folder: Path, name: str) -> tuple[dict, dict, str]:
    """Return answer and truth of a finished trial, and the hash of the code that spoke.

    Args:
        folder: Of the sweep.
        name: Of the trial.

    Raises:
        Unusable: Where either was changed since it was sealed.
    """
    answer = (folder / "answers" / f"{name}.json").read_bytes()
    truth = (folder / "truth" / f"{name}.json").read_bytes()
    seal = json.loads((folder / "seals" / f"{name}.json").read_text(encoding="utf-8"))
    faults = [
        f"the {kind} of trial {name} is not the one that was sealed."
        for kind, content in (("answer", answer), ("truth", truth))
        if digest(content) != seal[f"{kind}_sha256"]
    ]
    if faults:
        raise Unusable(f"Sweep {str(folder)!r}", faults)
    return json.loads(answer), json.loads(truth), seal["code_sha256"]


def digest(content: bytes) -> str:
    """Return the SHA-256 of some bytes."""
    return hashlib.sha256(content).hexdigest()


def digest_of_code() -> str:
    """Return the SHA-256 of all that claims anything."""
    total = hashlib.sha256()
    for file in sorted((ROOT / "stiffness").rglob("*.py")):
        total.update(file.relative_to(ROOT).as_posix().encode() + file.read_bytes())
    return total.hexdigest()


def sealed(file: Path, hashes: Mapping[str, str]) -> None:
    """Publish hashes."""
    written(file, json.dumps(hashes, indent=2) + "\n")


def written(file: Path, text: str) -> None:
    """Write a file whole or not at all."""
    waiting = file.with_suffix(".part")
    waiting.write_text(text, encoding="utf-8")
    waiting.replace(file)
