"""User model: a robot's own file, whole, as XML that a patch can be put into.

MuJoCo reads it and writes it back: includes are put in place, angles are in rad, every
part of it stays. Its meshes and pictures are read into memory, to lie in one folder
beside the new file, so that this can be moved.
"""

from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import mujoco

from bench.model_file import (
    LARGEST_MODEL,
    PATCH,
    plain_mjcf,
    read_spec,
    take_out_meshes,
    take_out_patch,
    take_out_pictures,
)

ASSETS = "model_assets"
"""Folder beside the model that holds its meshes and pictures."""


@dataclass(frozen=True)
class UserModel:
    """A robot's own file.

    Attributes:
        root: As XML with angles in rad; files are named in `ASSETS`.
        assets: Those files.
        lost: What of it could not be kept, in words.
    """

    model: mujoco.MjModel
    root: Element
    assets: dict[str, bytes]
    lost: tuple[str, ...] = ()


def user_model(file: Path) -> UserModel:
    """Read a robot's file with all that is in it, but for what a patch had added.

    Returns:
        The model; where its meshes or pictures cannot be read back, without them.

    Raises:
        ValueError: Where MuJoCo cannot compile it.
    """
    whole = read_spec(file)
    try:
        return _read_with(whole, _files_of(whole, file.parent))
    except (ValueError, RuntimeError, OSError) as error:
        bare = read_spec(file)
        _strip(bare)
        why = " ".join(str(error).split())
        lost = f"meshes and pictures of the file, which could not be read back: {why}"
        found = _read_with(bare, {})
        return UserModel(found.model, found.root, {}, (lost,))


def plain_model(nominal: mujoco.MjModel, *lost: str) -> UserModel:
    """Return an arm alone, where there is no file of it."""
    spec = mujoco.MjSpec.from_string(plain_mjcf(nominal))
    return UserModel(spec.compile(), ElementTree.fromstring(spec.to_xml()), {}, lost)


def _read_with(spec: mujoco.MjSpec, files: dict[str, tuple[str, bytes]]) -> UserModel:
    take_out_patch(spec)
    model = spec.compile()
    root = ElementTree.fromstring(spec.to_xml())
    _unwrap(root)
    taken: dict[str, bytes] = {}
    for element in root.iterfind("asset/*"):
        for key, name in list(element.attrib.items()):
            if key.startswith("file"):
                inside, data = files[name]
                taken[inside] = data
                element.set(key, f"{ASSETS}/{inside}")
    return UserModel(model, root, taken)


def _unwrap(root: Element) -> None:
    """Take away the bodies that an earlier patch inserted; poses follow later."""
    for parent in list(root.iter()):
        for body in parent.findall("body"):
            inner = body
            while inner.get("name", "").startswith(PATCH):
                inner = next(child for child in inner if child.tag == "body")
            if inner is not body:
                parent.insert(list(parent).index(body), inner)
                parent.remove(body)


def _strip(spec: mujoco.MjSpec) -> None:
    take_out_meshes(spec)
    take_out_pictures(spec)
    for skin in spec.skins:
        spec.delete(skin)


def _files_of(spec: mujoco.MjSpec, home: Path) -> dict[str, tuple[str, bytes]]:
    """Return each file that the model names: its new name, and its bytes."""
    found: dict[str, tuple[str, bytes]] = {}
    names = set()
    for part in (*spec.meshes, *spec.hfields, *spec.skins):
        names.add(part.file)
    for texture in spec.textures:
        names |= {texture.file, *texture.cubefiles}
    folders = [spec.compiler.meshdir, spec.compiler.texturedir, ""]
    for name in sorted(names - {""}):
        places = [home / folder / n for n in (name, Path(name).name)
                  for folder in folders]  # fmt: skip
        there = [place for place in places if place.is_file()]
        if not there:
            raise OSError(f"file {name!r} is not where the model says")
        data = there[0].read_bytes()
        _refuse_large_picture(name, data)
        inside, number = Path(name).name, 1
        while any(inside == other and data != d for other, d in found.values()):
            number += 1
            inside = f"{Path(name).stem}_{number}{Path(name).suffix}"
        found[name] = (inside, data)
    return found


def _refuse_large_picture(name: str, data: bytes) -> None:
    """Refuse a small PNG that unfolds to a huge picture."""
    if data[:8] == b"\x89PNG\r\n\x1a\n":
        width, height = (int.from_bytes(data[i : i + 4], "big") for i in (16, 20))
        if width * height > LARGEST_MODEL:
            raise OSError(f"picture {name!r} is {width} x {height}")
