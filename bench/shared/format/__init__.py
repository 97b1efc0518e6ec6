"""Format of recordings on disk: a manifest and a table of samples, in one folder.

Reading goes `folder` (what lies there) → `manifest` (recording.toml) and `table` with
`columns` and `cells` (the samples) → `checks` (do they fit each other and the robot?)
→ `assembly` (visits, stages, and a `Recording`, and back). What is wrong is collected
in `faults`.

`json_text` and `toml_text` write what files of ours hold, also those of answers.
"""

import json

import msgspec


def json_text(content: object, indent: int = 2) -> str:
    """Return the text of a JSON file; numbers read back to the last bit."""
    packed = msgspec.json.encode(content)
    return msgspec.json.format(packed, indent=indent).decode() + "\n"


def toml_text(value: str | bool) -> str:
    """Return a value in TOML: as in JSON, with one more character escaped."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
