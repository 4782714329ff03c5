"""What can be typed to the sub-commands about what there is to work with: `doctor`, `scenes` and `assets`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import tyro

from executor.cli.options.flag import Flag, Maybe


@dataclass(frozen=True)
class Doctor:
    """Examine this machine: what works, what is missing, what to do."""

    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


@dataclass(frozen=True)
class Scenes:
    """List the scenes that come with the package, or tell what is in a scene and whether it can be.

    What cannot be built, lies in another thing, is in mid-air or not where the facts say is an error. A
    scene_k_info.json of Digital Cousins is furnished with models of the library.
    """

    scene: tyro.conf.Positional[Maybe[str]] = None
    """Name of a scene, a scene's JSON file, or one of Digital Cousins."""
    out: Maybe[Path] = None
    """File for the scene as this program reads it; its folder is made when absent."""
    force: Flag = False
    """Replace the file when it exists."""
    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


@dataclass(frozen=True)
class Assets:
    """List the models that a scene's objects can name, with their ranges."""

    sheet: Maybe[Path] = None
    """File for a picture of all of them, one variation each; needs a renderer."""
    seed: int = 0
    """Which variation the picture shows."""
    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""


@dataclass(frozen=True)
class ImportAsset:
    """Make a model for scenes of a URDF, a PartNet-Mobility folder or a mesh, and tell what a robot can do with it."""

    source: tyro.conf.Positional[Path]
    """A .urdf file, a folder with mobility.urdf, or an OBJ, STL, PLY, glTF or DAE mesh."""
    name: Maybe[str] = None
    """Its name; scenes say imported/NAME. By default that of the source."""
    category: Maybe[str] = None
    """What it is, such as cabinet or mug; by default what the files say, else its name."""
    height_m: Maybe[float] = None
    """Its height in metres; by default the files' lengths are metres."""
    side: Maybe[Path] = None
    """JSON file with what overrules inference; by default affordances.json beside the source."""
    json: Flag = False
    """Print one JSON object on standard output."""
    debug: Flag = False
    """Show the traceback of an unexpected error."""
