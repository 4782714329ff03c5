"""An option that is given or not, such as `--json`; one that is on by default is taken back, such as `--no-video`."""

from __future__ import annotations

from typing import Annotated

import tyro

Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]
