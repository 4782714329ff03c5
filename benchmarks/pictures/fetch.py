"""Bring the benchmark's pictures into a folder: from GitHub, from a local copy, or from an installed package.

    python -m benchmarks.pictures.fetch runs/pictures
    python -m benchmarks.pictures.fetch runs/pictures --from mirror      # mirror/OWNER/REPOSITORY/PATH

Each picture becomes ID.png or ID.jpg, its depth ID_depth.png (.pgm, .npy), its intrinsics ID_camera.json. Size and hash
of every file are known beforehand; what differs is not kept. A file that is there, and right, is not fetched again.
"""

from __future__ import annotations

import argparse
import hashlib
import importlib.util
import json
import os
import re
import sys
import tomllib
import urllib.parse
import urllib.request
from collections.abc import Mapping, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

HERE = Path(__file__).parent
INDEX = HERE / "pictures.toml"

_TIMEOUT_S = 60.0
_MOST_BYTES = 16_000_000
_ID = re.compile(r"[a-z][a-z0-9_]*")
_REPOSITORY = re.compile(r"[A-Za-z0-9][A-Za-z0-9-]*/[A-Za-z0-9][A-Za-z0-9._-]*")
_COMMIT = re.compile(r"[0-9a-f]{40}")
_SUFFIXES = (".png", ".jpg", ".pgm", ".npy")

Json = Mapping[str, Any]


class NotFetched(Exception):
    """A file that cannot be had, or is another one than the index says."""


def pictures(index: Path = INDEX) -> list[dict[str, Any]]:
    """Return the entries of the index, as they are written there."""
    entries: list[dict[str, Any]] = tomllib.loads(index.read_text(encoding="utf-8"))["pictures"]
    return entries


def file_names(entry: Json) -> dict[str, str]:
    """Return the name in the user's folder of each file of a picture: `color`, and `depth` if it has one."""
    if not _ID.fullmatch(entry["id"]):
        raise NotFetched(f"{entry['id']!r} is no id of a picture")
    names = {}
    for kind, end in (("color", ""), ("depth", "_depth")):
        if kind in entry:
            suffix = _inside(entry[kind]["path"]).suffix.lower()
            if suffix not in _SUFFIXES:
                raise NotFetched(f"{entry['id']}: {suffix} is no form of a picture")
            names[kind] = f"{entry['id']}{end}{suffix}"
    return names


def fetch(entry: Json, folder: Path, local: Path | None = None) -> list[Path]:
    """Bring one picture's files into a folder, and return their paths.

    Args:
        entry: Of the index.
        folder: Where to; it exists.
        local: Folder with OWNER/REPOSITORY/PATH, in place of GitHub.

    Raises:
        NotFetched: A file cannot be had, or is another one than the index says. Nothing of it is kept.
    """
    written = []
    for kind, name in file_names(entry).items():
        target = folder / name
        if not _is_right(target, entry[kind]):
            content = _content(entry, entry[kind], local)
            part = target.with_name(f"{name}.part")
            part.write_bytes(content)
            os.replace(part, target)
        written.append(target)
    camera = {key: entry["camera"][key] for key in ("fx", "fy", "cx", "cy")}
    target = folder / f"{entry['id']}_camera.json"
    target.write_text(json.dumps(camera) + "\n", encoding="utf-8")
    return [*written, target]


def _inside(path: str) -> PurePosixPath:
    """Return a path that stays below where it starts."""
    pure = PurePosixPath(path)
    if pure.is_absolute() or not pure.parts or ".." in pure.parts or "\\" in path or "\0" in path:
        raise NotFetched(f"{path!r} is no path inside a repository")
    return pure


def _is_right(path: Path, file: Json) -> bool:
    if not path.is_file() or path.stat().st_size != file["bytes"]:
        return False
    return hashlib.sha256(path.read_bytes()).hexdigest() == str(file["sha256"])


def _content(entry: Json, file: Json, local: Path | None) -> bytes:
    """Return a file's content, which has the size and the hash of the index."""
    path, size = _inside(file["path"]), int(file["bytes"])
    if size > _MOST_BYTES:
        raise NotFetched(f"{entry['id']}: {path} has {size} bytes, at most {_MOST_BYTES} are fetched")
    try:
        if "package" in entry:
            content = _read(_package_folder(entry["package"]) / path, size)
        elif local is not None:
            content = _read(local / _repository(entry) / path, size)
        else:
            content = _download(_url(entry, path), size)
    except OSError as error:
        raise NotFetched(f"{entry['id']}: {path} cannot be had ({error})") from error
    if len(content) != size or hashlib.sha256(content).hexdigest() != file["sha256"]:
        raise NotFetched(f"{entry['id']}: {path} is another file than the index says, or another version")
    return content


def _repository(entry: Json) -> str:
    name = str(entry["repository"])
    if not _REPOSITORY.fullmatch(name) or not _COMMIT.fullmatch(entry["commit"]):
        raise NotFetched(f"{entry['id']}: {name!r} at {entry['commit']!r} is no commit of a repository")
    return name


def _url(entry: Json, path: PurePosixPath) -> str:
    return f"https://raw.githubusercontent.com/{_repository(entry)}/{entry['commit']}/{urllib.parse.quote(str(path))}"


def _package_folder(package: str) -> Path:
    found = importlib.util.find_spec(package)
    if found is None or found.origin is None:
        raise NotFetched(f"the package {package} is not installed")
    return Path(found.origin).parent


def _read(path: Path, size: int) -> bytes:
    with path.open("rb") as stream:
        return stream.read(size + 1)


def _download(url: str, size: int) -> bytes:
    with urllib.request.urlopen(url, timeout=_TIMEOUT_S) as answer:
        if not answer.geturl().startswith("https://"):
            raise NotFetched(f"{url} leads to {answer.geturl()}")
        content: bytes = answer.read(size + 1)
    return content


def main(arguments: Sequence[str] | None = None) -> int:
    """Fetch all pictures, or those that are named; return 1 if any is missing."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("folder", type=Path, help="where the pictures go, outside of the repository or ignored by it")
    parser.add_argument("--from", dest="local", type=Path, help="folder with OWNER/REPOSITORY/PATH, in place of GitHub")
    parser.add_argument("--only", nargs="+", default=[], metavar="ID", help="some pictures in place of all")
    chosen = parser.parse_args(arguments)
    entries = pictures()
    unknown = sorted(set(chosen.only) - {entry["id"] for entry in entries})
    if unknown:
        parser.error(f"no such pictures: {', '.join(unknown)}")
    if chosen.folder.resolve().is_relative_to(HERE.resolve()):
        parser.error("pictures are not kept beside their annotations; give another folder")
    chosen.folder.mkdir(parents=True, exist_ok=True)
    missing = 0
    for entry in entries:
        if chosen.only and entry["id"] not in chosen.only:
            continue
        try:
            fetch(entry, chosen.folder, chosen.local)
        except NotFetched as error:
            missing += 1
            print(f"not fetched: {error}", file=sys.stderr)
        else:
            print(entry["id"])
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
