"""Pictures of episodes: where they are, how videos are joined without decoding them, and their colours."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from executor.datasets.footage import encoded, opened_video, pixels_of
from executor.datasets.formats.statistics import Tones
from executor.machine.extras import require
from executor.pictures.video import VideoFailed

_LOOKED_AT = 20  # Pictures of an episode whose colours are counted: LeRobot takes a sample too.


class Clip(Protocol):
    """The pictures of an episode of one view and kind."""

    def pictures(self) -> Iterator[NDArray[Any]]:
        """Yields (H, W, 3) uint8 RGB, or (H, W) uint16."""
        ...


@dataclass(frozen=True, slots=True)
class ReadClip:
    """Pictures that are read of an array.

    Attributes:
        place: Where it is, for messages.
        read: Begins to read them.
    """

    place: str
    read: Callable[[], Iterator[NDArray[Any]]]

    def pictures(self) -> Iterator[NDArray[Any]]:
        """Yields them.

        Raises:
            VideoFailed: They cannot be read.
        """
        try:
            yield from self.read()
        except (OSError, ValueError, KeyError, TypeError) as problem:
            raise VideoFailed(f"the pictures {self.place} cannot be read: {problem}") from problem


@dataclass(frozen=True, slots=True)
class VideoClip:
    """Pictures in a video file.

    Attributes:
        path: The file.
        rate_hz: Pictures a second.
        first: Which of the file's pictures is the first of these; it is a complete one.
        count: How many they are.
    """

    path: Path
    rate_hz: float
    first: int
    count: int

    def pictures(self) -> Iterator[NDArray[Any]]:
        """Yields them.

        Raises:
            VideoFailed: The file cannot be read, or has too few.
        """
        found = 0
        with opened_video(self.path) as (source, stream):
            self._seek(source, stream)
            for frame in source.decode(stream):
                if self._place(frame) < self.first:
                    continue
                yield frame.to_ndarray(format=pixels_of(self.path))
                found += 1
                if found == self.count:
                    return
        raise VideoFailed(f"{self.path} has {found} of {self.count} pictures from number {self.first} on")

    def packets(self) -> Iterator[tuple[Any, Any]]:
        """Yields the stream and an encoded picture, one after the other, without decoding any.

        Raises:
            VideoFailed: The file cannot be read, or has too few.
        """
        found = 0
        with opened_video(self.path) as (source, stream):
            self._seek(source, stream)
            for packet in source.demux(stream):
                if packet.size and self._place(packet) >= self.first and found < self.count:
                    yield stream, packet
                    found += 1
        if found < self.count:
            raise VideoFailed(f"{self.path} has {found} of {self.count} pictures from number {self.first} on")

    def tones(self) -> Tones:
        """Returns the colours of some of the pictures, evenly spread.

        Raises:
            VideoFailed: The file cannot be read.
        """
        tones, due = Tones(), self.first
        with opened_video(self.path) as (source, stream):
            self._seek(source, stream)
            stream.codec_context.skip_frame = "NONKEY"
            for frame in source.decode(stream):
                at = self._place(frame)
                if at >= self.first + self.count:
                    break
                if at >= due:
                    tones.add(frame.to_ndarray(format="rgb24"))
                    due = at + apart(self.count)
        return tones

    def _place(self, what: Any) -> int:
        """Returns the number of a picture, complete or encoded, in the file."""
        return round(float(what.pts * what.time_base) * self.rate_hz)

    def _seek(self, source: Any, stream: Any) -> None:
        """Goes to the first picture, where it is not the file's."""
        stream.codec_context.thread_count = 1
        if self.first:
            source.seek(round(self.first / self.rate_hz / float(stream.time_base)), stream=stream, backward=True)


def apart(count: int) -> int:
    """Returns how many pictures apart those are whose colours are counted, of an episode of so many."""
    return max(count // _LOOKED_AT, 1)


def depth_tones(pictures: Iterable[NDArray[np.uint16]], count: int) -> Tones:
    """Returns how often each number occurs in some of an episode's pictures of one number a point, evenly spread."""
    tones = Tones(channels=1, levels=1 << 16, largest=1.0)
    for picture in islice(pictures, 0, None, apart(count)):
        tones.add(picture[..., None])
    return tones


def as_video(clip: Clip, path: Path, rate_hz: float, count: int) -> VideoClip:
    """Returns a clip's pictures in a video file: its own, or one that is encoded now.

    Args:
        clip: Pictures in colours.
        path: Where it is encoded, if it has to be.
        rate_hz: Pictures a second.
        count: How many it has.

    Raises:
        VideoFailed: It cannot be read or encoded.
        OSError: The file cannot be written.
    """
    if isinstance(clip, VideoClip):
        return clip
    pictures = clip.pictures()
    first = next(pictures)
    with encoded(path, (first.shape[1], first.shape[0]), Fraction(rate_hz).limit_denominator(1000)) as track:
        track.add(first)
        for picture in pictures:
            track.add(picture)
    return VideoClip(path, rate_hz, 0, count)


class Reel:
    """A video file that clips are added to, packet by packet.

    Attributes:
        pictures, bytes: How many it has, and their size.

    Args:
        path: The file; its folder exists.
        rate_hz: Pictures a second.
    """

    def __init__(self, path: Path, rate_hz: float) -> None:
        self.pictures = self.bytes = 0
        self._path, self._rate_hz = path, rate_hz
        self._av: Any = require("av", "data")
        # Without "bitexact" a file says which library made it.
        self._out: Any = self._av.open(str(path), "w", format="mp4", options={"fflags": "+bitexact"})
        self._stream: Any = None
        self._heads = b""

    def add(self, clip: VideoClip) -> tuple[float, float]:
        """Adds a clip, and returns when it begins and ends in this one, in s.

        Raises:
            VideoFailed: It cannot be read, or was encoded in another way than those before it.
            OSError: The file cannot be written.
        """
        begins = self.pictures
        for source, packet in clip.packets():
            heads = bytes(source.codec_context.extradata or b"")
            if self._stream is None:
                self._stream = self._out.add_stream_from_template(source)
                self._stream.time_base = source.time_base
                # That of the file that a clip is cut out of says nothing of the clip.
                self._stream.codec_context.bit_rate = 0
                self._heads = heads
            elif heads != self._heads:
                raise VideoFailed(f"{clip.path} was encoded otherwise than the episodes before it; generate it anew")
            each = 1.0 / self._rate_hz / float(packet.time_base)
            packet.pts = packet.dts = round(self.pictures * each)
            packet.duration = round((self.pictures + 1) * each) - packet.pts
            packet.stream = self._stream
            self.bytes += packet.size
            self.pictures += 1
            with _blamed(self._path):
                self._out.mux(packet)
        return begins / self._rate_hz, self.pictures / self._rate_hz

    def close(self) -> None:
        """Finishes the file; a second time does nothing."""
        with _blamed(self._path):
            self._out.close()


def count_of(video: Path) -> int:
    """Returns how many pictures a video has.

    Raises:
        VideoFailed: It cannot be read.
    """
    with opened_video(video) as (source, stream):
        return sum(1 for packet in source.demux(stream) if packet.size)


@contextmanager
def _blamed(path: Path) -> Iterator[None]:
    """Lets what goes wrong in writing a file name it.

    Raises:
        OSError: It cannot be written.
        VideoFailed: It cannot be made.
    """
    av: Any = require("av", "data")
    try:
        yield
    except av.FFmpegError as problem:
        if isinstance(problem, OSError):
            raise OSError(problem.errno, problem.strerror, str(path)) from problem
        raise VideoFailed(f"the video {path} could not be written: {problem}") from problem
