"""The page that shows a reconstruction: the picture with outlines, and what every thing was taken for and why."""

from __future__ import annotations

import math

import numpy as np

from executor.photo.fitting.likelihood import Fit
from executor.photo.inputs.depth import Depth
from executor.photo.overlay import cut, outlined, shown_things
from executor.photo.pipeline import Result
from executor.photo.room.reconstruct import FittedThing
from executor.photo.space.floor import FloorSeen
from executor.photo.space.observation import Noise
from executor.photo.variations import RoomVariation
from executor.results.report.html import (
    badge,
    bullets,
    card,
    document,
    facts,
    jpeg,
    soft,
    strip,
    style,
    table,
    text,
)

_SURE = 0.7  # A right fit to a box that is 3 % off has about 0.8.


def photo_page(result: Result) -> str:
    """Returns the report of a reconstruction as a page without any other file."""
    guesses = {thing.id: thing.fit.guess for thing in result.found.things}
    picture = outlined(result.seen, shown_things(result.seen, guesses))
    things = [_thing(thing, result, cut(picture, thing.detection.box_px)) for thing in result.found.things]
    left_out = [
        *(f"{one.detection.label or 'thing'}: {one.reason}" for one in result.found.unfitted),
        *(f"{one.label}: {one.reason}" for one in result.given.left_out),
    ]
    body = [
        f"<h1>{text(result.given.name)}</h1>",
        card(
            _verdict(result),
            strip("photograph and fits", [(jpeg(picture), "the photograph with outlines of the fits")]),
        ),
        card("<h2>What was given and measured</h2>", _given(result)),
        card("<h2>In doubt</h2>", bullets(result.given.doubts)) if result.given.doubts else "",
        card("<h2>Left out</h2>", bullets(left_out)) if left_out else "",
        card("<h2>Moved so that it can be</h2>", bullets(result.made.notes)) if result.made.notes else "",
        "<h2>Things</h2>",
        *things,
        card("<h2>Variations</h2>", bullets([_variation(one) for one in result.varied])) if result.varied else "",
    ]
    return document(f"{result.given.name}: from a photograph", body, style("page"))


def _verdict(result: Result) -> str:
    if result.made.refused:
        return badge("not a scene to work in", "bad") + soft(text(result.made.refused))
    count = len(result.found.things)
    return badge("settled in physics", "good") + soft(f"{count} things; scene.json has the scene.")


def _variation(one: RoomVariation) -> str:
    models = ", ".join(f"{key} as {model}" for key, model in one.models.items())
    ending = f"physics refuses it: {one.made.refused}" if one.made.refused else f"scene_{one.number}.json"
    return f"{models}: {ending}"


def _given(result: Result) -> str:
    given, floor, noise = result.given, result.floor, result.seen.noise
    sources = sorted({one.source for one in given.detections})
    return facts(
        (
            ("picture", text(f"{given.picture.source.name}, {given.picture.size_px[0]} x {given.picture.size_px[1]}")),
            ("depth", "none" if given.depth is None else text(given.depth.source)),
            ("camera", text(given.camera.source)),
            ("boxes and names", text(", ".join(sources))),
            ("camera above the floor", f"{floor.height_m:.3f} m, looking {floor.tilt_deg:.1f} degrees down"),
            ("level and scale by", text(floor.source)),
            *_measured(given.depth, floor, noise),
            ("walls", str(len(result.found.walls))),
            ("took", text(", ".join(f"{step} {seconds:.1f} s" for step, seconds in result.took_s.items()))),
        )
    )


def _compared(fit: Fit) -> str:
    """What of a thing was compared, and how exact it is."""
    if fit.spread_m is None:
        return f"what stands out in its box, {1000 * fit.residual_m:.1f} mm off"
    return f"its box; its place is known within {100 * fit.spread_m:.0f} cm"


def _measured(depth: Depth | None, floor: FloorSeen, noise: Noise) -> tuple[tuple[str, str], ...]:
    if depth is None:
        return (("scale known within", f"{100 * floor.spread_share:.1f} %"),)
    return (
        ("floor seen", f"{floor.seen_m2:.1f} m&sup2;, {1000 * floor.residual_m:.1f} mm off a plane"),
        ("noise of depth", f"{1000 * float(noise.sigma_m(np.array(2.0))):.1f} mm at 2 m"),
    )


def _thing(thing: FittedThing, result: Result, picture: np.ndarray) -> str:
    fit, guess = thing.fit, thing.fit.guess
    tone = "good" if fit.confidence >= _SURE else "warn"
    length, width, height = guess.size_m
    settled_m = result.made.settled_m.get(thing.id)
    rows = [
        ("taken for", text(f"{guess.entry.model} ({guess.entry.category})")),
        ("named by", text(f"{thing.detection.source}: {thing.detection.label or 'no name'}")),
        (
            "at",
            f"{guess.x_m:.3f} {guess.y_m:.3f} m, {guess.bottom_m:.3f} m high, {math.degrees(guess.yaw_rad):.0f}&deg;",
        ),
        ("size", f"{length:.3f} x {width:.3f} x {height:.3f} m"),
        ("options", text(", ".join(f"{key} {value}" for key, value in guess.parameters) or "none")),
        ("colour", "none seen" if fit.colour is None else f"rgb({', '.join(map(str, fit.colour))})"),
        ("explains", f"{100 * fit.explained:.0f} % of {_compared(fit)}"),
        ("in its box", f"what is visible of it has an IoU of {fit.in_box:.2f} with the box"),
        ("sure of the model alone", f"{100 * fit.likelier:.0f} %, against the next one"),
    ]
    if settled_m is not None:
        rows.append(("settling moved it by", f"{1000 * settled_m:.1f} mm"))
    others = [
        (
            text(one.guess.entry.model),
            f"{one.cost - fit.cost:.1f}",
            " x ".join(f"{side:.2f}" for side in one.guess.size_m),
        )
        for one in fit.alternatives
    ]
    below = table(others, ("instead", "less likely by (log)", "size [m]")) if others else ""
    return card(
        f"<h3>{text(thing.id)} {badge(f'{100 * fit.confidence:.0f} % sure', tone)}</h3>",
        strip("", [(jpeg(np.ascontiguousarray(picture)), thing.id)]),
        facts(rows),
        below,
    )
