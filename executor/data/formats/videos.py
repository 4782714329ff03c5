"""Picture clips of episodes: reading, joining videos without decoding, and colour histograms."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from executor.data.formats.statistics import IntensityHistogram
from executor.data.views import opened_video, pictures
from executor.sim.render.frames import VideoFailed
from executor.system.extras import require

_LOOKED_AT = 20  # Pictures of an episode in its histogram: LeRobot samples, too.


@dataclass(frozen=True, slots=True)
class VideoClip:
    """Pictures in a video file.

    Attributes:
        path: The file.
        rate_hz: Pictures per second.
        count: Number of pictures.
    """

    path: Path
    rate_hz: float
    count: int

    def pictures(self) -> Iterator[NDArray[Any]]:
        """Yield them.

        Raises:
            VideoFailed: The file is unreadable or too short.
        """
        found = 0
        for picture in islice(pictures(self.path), self.count):
            found += 1
            yield picture
        if found < self.count:
            raise VideoFailed(f"{self.path} has {found} of {self.count} pictures")

    def packets(self) -> Iterator[tuple[Any, Any]]:
        """Yield the stream and each encoded picture, without decoding.

        Raises:
            VideoFailed: The file is unreadable or too short.
        """
        found = 0
        with opened_video(self.path) as (source, stream):
            for packet in source.demux(stream):
                if packet.size and found < self.count:
                    yield stream, packet
                    found += 1
        if found < self.count:
            raise VideoFailed(f"{self.path} has {found} of {self.count} pictures")

    def histogram(self) -> IntensityHistogram:
        """Return the colour histogram of some of the pictures, evenly spread.

        Raises:
            VideoFailed: The file is unreadable.
        """
        histogram, due = IntensityHistogram(), 0
        with opened_video(self.path) as (source, stream):
            stream.codec_context.thread_count = 1
            stream.codec_context.skip_frame = "NONKEY"
            for frame in source.decode(stream):
                at = round(float(frame.pts * frame.time_base) * self.rate_hz)
                if at >= self.count:
                    break
                if at >= due:
                    histogram.add(frame.to_ndarray(format="rgb24"))
                    due = at + sampling_stride(self.count)
        return histogram


def sampling_stride(count: int) -> int:
    """Return the stride between the pictures that are counted in a histogram, of an episode of `count`."""
    return max(count // _LOOKED_AT, 1)


def depth_histogram(pictures: Iterable[NDArray[np.uint16]], count: int) -> IntensityHistogram:
    """Return the histogram of some of an episode's one-channel pictures, evenly spread."""
    histogram = IntensityHistogram(channels=1, levels=1 << 16, largest=1.0)
    for picture in islice(pictures, 0, None, sampling_stride(count)):
        histogram.add(picture[..., None])
    return histogram


class VideoWriter:
    """Video file that clips are appended to, packet by packet.

    Attributes:
        pictures, bytes: Their number and size so far.

    Args:
        path: The file, in an existing folder.
        rate_hz: Pictures per second.
    """

    def __init__(self, path: Path, rate_hz: float) -> None:
        self.pictures = self.bytes = 0
        self._path, self._rate_hz = path, rate_hz
        self._av: Any = require("av", "data")
        # Without "bitexact" a file contains its library.
        self._out: Any = self._av.open(str(path), "w", format="mp4", options={"fflags": "+bitexact"})
        self._stream: Any = None
        self._heads = b""

    def add(self, clip: VideoClip) -> tuple[float, float]:
        """Append a clip, and return its begin and end in this file [s].

        Raises:
            VideoFailed: It is unreadable, or was encoded differently from those before it.
            OSError: The file cannot be written.
        """
        begins = self.pictures
        for source, packet in clip.packets():
            heads = bytes(source.codec_context.extradata or b"")
            if self._stream is None:
                self._stream = self._out.add_stream_from_template(source)
                self._stream.time_base = source.time_base
                # The source file's bit rate is not the clip's.
                self._stream.codec_context.bit_rate = 0
                self._heads = heads
            elif heads != self._heads:
                raise VideoFailed(f"{clip.path} was encoded otherwise than the episodes before it; generate it again")
            each = 1.0 / self._rate_hz / float(packet.time_base)
            packet.pts = packet.dts = round(self.pictures * each)
            packet.duration = round((self.pictures + 1) * each) - packet.pts
            packet.stream = self._stream
            self.bytes += packet.size
            self.pictures += 1
            with _errors_name_file(self._path):
                self._out.mux(packet)
        return begins / self._rate_hz, self.pictures / self._rate_hz

    def close(self) -> None:
        """Finish the file; a second call does nothing."""
        with _errors_name_file(self._path):
            self._out.close()


def count_pictures(video: Path) -> int:
    """Return the number of pictures of a video.

    Raises:
        VideoFailed: It is unreadable.
    """
    with opened_video(video) as (source, stream):
        return sum(1 for packet in source.demux(stream) if packet.size)


@contextmanager
def _errors_name_file(path: Path) -> Iterator[None]:
    """Make errors of writing name the file.

    Raises:
        OSError: It cannot be written.
        VideoFailed: It cannot be encoded.
    """
    av: Any = require("av", "data")
    try:
        yield
    except av.FFmpegError as problem:
        if isinstance(problem, OSError):
            raise OSError(problem.errno, problem.strerror, str(path)) from problem
        raise VideoFailed(f"the video {path} could not be written: {problem}") from problem
