"""Videos of episodes, put one after the other as they are, without decoding them, and looked at here and there."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from executor.datasets.formats.statistics import Tones
from executor.machine.extras import require
from executor.pictures.video import VideoFailed

_LOOKED_AT = 20  # Pictures of an episode whose colours are counted: LeRobot takes a sample too.


class Reel:
    """A video file that whole videos are added to, packet by packet.

    Attributes:
        pictures, bytes: How many it has, and their size.

    Args:
        path: The file; its folder exists.
        rate: Pictures a second.
    """

    def __init__(self, path: Path, rate: float) -> None:
        self.pictures = self.bytes = 0
        self._rate = rate
        self._av: Any = require("av", "data")
        # Without "bitexact" a file says which library made it.
        self._out: Any = self._av.open(str(path), "w", format="mp4", options={"fflags": "+bitexact"})
        self._stream: Any = None
        self._heads = b""

    def add(self, video: Path) -> tuple[float, float]:
        """Adds a video, and returns when it begins and ends in this one, in s.

        Raises:
            VideoFailed: It cannot be read, or was encoded in another way than those before it.
        """
        begins = self.pictures
        try:
            with self._av.open(str(video)) as source:
                stream = source.streams.video[0]
                heads = bytes(stream.codec_context.extradata or b"")
                if self._stream is None:
                    self._stream = self._out.add_stream_from_template(stream)
                    self._stream.time_base = stream.time_base
                    self._heads = heads
                elif heads != self._heads:
                    raise VideoFailed(f"{video} was encoded otherwise than the episodes before it; generate it anew")
                for packet in source.demux(stream):
                    if packet.size:
                        offset = round(begins / self._rate / float(packet.time_base))
                        packet.pts, packet.dts = packet.pts + offset, packet.dts + offset
                        packet.stream = self._stream
                        self._out.mux(packet)
                        self.pictures += 1
                        self.bytes += packet.size
        except self._av.FFmpegError as problem:
            if isinstance(problem, OSError) and problem.filename != str(video):
                raise
            raise VideoFailed(f"{video} cannot be read: {problem}") from problem
        return begins / self._rate, self.pictures / self._rate

    def close(self) -> None:
        """Finishes the file; a second time does nothing."""
        self._out.close()


def count_of(video: Path) -> int:
    """Returns how many pictures a video has.

    Raises:
        VideoFailed: It cannot be read.
    """
    av: Any = require("av", "data")
    try:
        with av.open(str(video)) as source:
            return sum(1 for packet in source.demux(video=0) if packet.size)
    except av.FFmpegError as problem:
        raise VideoFailed(f"{video} cannot be read: {problem}") from problem


def tones_of(video: Path, count: int) -> Tones:
    """Returns the colours of some pictures of a video of so many, evenly spread.

    Raises:
        VideoFailed: It cannot be read.
    """
    av: Any = require("av", "data")
    tones = Tones()
    wanted = max(count // _LOOKED_AT, 1)
    try:
        with av.open(str(video)) as source:
            stream = source.streams.video[0]
            stream.codec_context.thread_count = 1
            stream.codec_context.skip_frame = "NONKEY"
            due = 0
            for frame in source.decode(stream):
                at = round(float(frame.pts * frame.time_base * stream.average_rate))
                if at >= due:
                    tones.add(frame.to_ndarray(format="rgb24"))
                    due = at + wanted
    except av.FFmpegError as problem:
        raise VideoFailed(f"{video} cannot be read: {problem}") from problem
    return tones
