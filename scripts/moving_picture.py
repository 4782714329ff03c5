"""Make the moving picture of README and documents from a run's video.

scene2demo run "put the glass into the refrigerator" --scene kitchen_t1 --out runs/t1
python scripts/moving_picture.py runs/t1/video.mp4 docs/images/t1.webp
"""

from __future__ import annotations

import sys
from pathlib import Path

import av
from PIL import Image

_SIZE, _FRAMES, _SHOWN_MS, _QUALITY = (560, 420), 90, 130, 45


def main(video: Path, picture: Path) -> None:
    """Write evenly spaced frames of a video as an animated WebP."""
    with av.open(str(video)) as source:
        frames = [frame.to_image() for frame in source.decode(video=0)]
    shown = [frames[round(k * (len(frames) - 1) / (_FRAMES - 1))] for k in range(_FRAMES)]
    first, *others = (frame.resize(_SIZE, Image.Resampling.LANCZOS) for frame in shown)
    first.save(picture, save_all=True, append_images=others, duration=_SHOWN_MS, loop=0, quality=_QUALITY, method=3)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
