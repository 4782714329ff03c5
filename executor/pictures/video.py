"""One MP4 of a rollout: the overview large, the robot's two views beside it, a caption above them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from bddl.files import temporary_beside
from executor.machine.extras import require
from executor.pictures.frames import Frames, Picture
from executor.records.captions import Caption

Font = ImageFont.FreeTypeFont | ImageFont.ImageFont
SPEED = 2.0
"""How many times faster than real time a video plays."""

_BAR_PX = 56
_BAR_COLOR = (24, 26, 31)
_TITLE_COLOR = (240, 241, 244)
_DETAIL_COLOR = (168, 173, 184)
_ACCENT_COLOR = (88, 166, 255)
_QUALITY = "23"


class VideoFailed(RuntimeError):
    """The video could not be encoded."""


def write_video(
    path: Path | str,
    frames: Frames,
    captions: Sequence[Caption],
    *,
    rate_hz: float = 10.0,
    speed: float = SPEED,
    listen: Callable[[int, int], None] | None = None,
) -> Path:
    """Writes an H.264 MP4 that browsers and players open, and returns its path.

    Args:
        path: The file; it appears only when it is complete.
        frames: Pictures of each view.
        captions: One for each picture.
        rate_hz: Recorded samples a second of simulated time.
        speed: How many times faster than real time it plays.
        listen: Told how many pictures are encoded, and of how many.

    Raises:
        ValueError: When there are no pictures, or captions and pictures differ in number.
        VideoFailed: When the encoder refuses.
    """
    av: Any = require("av", "data")

    if frames.count == 0 or frames.count != len(captions):
        raise ValueError(f"expected one caption for each of {frames.count} pictures, got {len(captions)}")
    composer = Composer(frames)
    with temporary_beside(Path(path)) as temporary:
        try:
            with av.open(str(temporary), "w", format="mp4", options={"movflags": "faststart"}) as container:
                rate = Fraction(rate_hz * speed).limit_denominator(1000)
                stream = container.add_stream("libx264", rate=rate)
                stream.width, stream.height = composer.size
                stream.pix_fmt = "yuv420p"
                stream.options = {"crf": _QUALITY, "preset": "veryfast", "g": "40"}
                for index, caption in enumerate(captions):
                    picture = av.VideoFrame.from_ndarray(composer.compose(index, caption), format="rgb24")
                    for packet in stream.encode(picture):
                        container.mux(packet)
                    if listen is not None:
                        listen(index + 1, len(captions))
                for packet in stream.encode():
                    container.mux(packet)
        except av.FFmpegError as error:
            raise VideoFailed(f"the video {path} could not be encoded: {error}") from error
    return Path(path)


class Composer:
    """Puts the views of one moment and its caption into one picture.

    The overview stands left; the other views are stacked right of it, together as high as it is. Without an overview
    the views stand side by side.
    """

    def __init__(self, frames: Frames) -> None:
        self._frames = frames
        self._title = _font(19)
        self._detail = _font(15)
        overview = frames.views.get("global")
        others = [view for view in frames.views if view != "global"]
        self._places: dict[str, tuple[int, int, int, int]] = {}
        if overview is not None and others:
            width, height = overview.shape[2], overview.shape[1]
            side_height = height // len(others)
            side_width = frames.size[0] * side_height // frames.size[1]
            self._places["global"] = (0, 0, width, height)
            for row, view in enumerate(others):
                self._places[view] = (width, row * side_height, side_width, side_height)
            self._picture_size = (width + side_width, height)
        else:
            height = max(pictures.shape[1] for pictures in frames.views.values())
            x = 0
            for view, pictures in frames.views.items():
                width = pictures.shape[2] * height // pictures.shape[1]
                self._places[view] = (x, 0, width, height)
                x += width
            self._picture_size = (x, height)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the composed pictures; both are even, as the encoder wants."""
        width, height = self._picture_size
        return width + width % 2, height + height % 2 + _BAR_PX

    def compose(self, index: int, caption: Caption) -> Picture:
        """Returns the (H, W, 3) picture of one moment."""
        canvas = Image.new("RGB", self.size, _BAR_COLOR)
        for view, (x, y, width, height) in self._places.items():
            picture = Image.fromarray(np.ascontiguousarray(self._frames.views[view][index]))
            if picture.size != (width, height):
                picture = picture.resize((width, height), Image.Resampling.LANCZOS)
            canvas.paste(picture, (x, y + _BAR_PX))
        self._write(ImageDraw.Draw(canvas), caption)
        return np.asarray(canvas)

    def _write(self, draw: ImageDraw.ImageDraw, caption: Caption) -> None:
        # The caption stands above the pictures, since players lay their controls over the lower edge.
        width, _ = self.size
        clock = f"{caption.time_s:.1f} s"
        draw.rectangle((0, _BAR_PX - 3, round(width * caption.progress), _BAR_PX - 1), fill=_ACCENT_COLOR)
        room = width - 24 - draw.textlength(clock, font=self._detail) - 12
        draw.text((12, 6), _fitted(draw, caption.title, self._title, room), _TITLE_COLOR, font=self._title)
        draw.text((12, 30), _fitted(draw, caption.detail, self._detail, room), _DETAIL_COLOR, font=self._detail)
        draw.text((width - 12, 9), clock, _DETAIL_COLOR, font=self._detail, anchor="ra")


def _font(size_px: int) -> Font:
    """Returns Pillow's own font, so that no font of the machine is needed and pictures are alike everywhere."""
    return ImageFont.load_default(size_px)


def _fitted(draw: ImageDraw.ImageDraw, text: str, font: Font, room_px: float) -> str:
    """Returns the text, cut with an ellipsis where it is too long."""
    if draw.textlength(text, font=font) <= room_px:
        return text
    while text and draw.textlength(text + "...", font=font) > room_px:
        text = text[:-1]
    return text + "..."
