"""Solves inverse kinematics with ikpy; runs in that package's own environment.

Reads a JSON line of 4x4 targets from standard input, and answers with a line: the arm's joint angles for each, and the
seconds that solving took.
"""

from __future__ import annotations

import json
import sys
import time
import warnings

import numpy as np
from ikpy.chain import Chain

JOINTS = 7


def arm_of(urdf: str, base: str, hand: str) -> Chain:
    """Return the chain from base to hand with its fixed links held."""
    warnings.simplefilter("ignore")
    chain = Chain.from_urdf_file(urdf, base_elements=[base], last_link_vector=None, symbolic=True)
    names = [link.name for link in chain.links]
    last = next(index for index, name in enumerate(names) if hand in name)
    chain.links = chain.links[: last + 1]
    chain.active_links_mask = np.array([link.joint_type == "revolute" for link in chain.links])
    if int(chain.active_links_mask.sum()) != JOINTS:
        raise SystemExit(f"the chain has {chain.active_links_mask.sum()} moving joints, not {JOINTS}: {names}")
    return chain


def main() -> None:
    """Answers targets until the input ends."""
    chain = arm_of(*sys.argv[1:4])
    start = np.zeros(len(chain.links))
    for index, link in enumerate(chain.links):
        if chain.active_links_mask[index]:
            start[index] = sum(link.bounds) / 2
    for line in sys.stdin:
        wanted = np.array(json.loads(line))
        begin = time.perf_counter()
        found = [chain.inverse_kinematics_frame(T, initial_position=start, orientation_mode="all") for T in wanted]
        seconds = time.perf_counter() - begin
        postures = [angles[chain.active_links_mask].tolist() for angles in found]
        print(json.dumps({"postures": postures, "seconds": seconds}), flush=True)


if __name__ == "__main__":
    main()
