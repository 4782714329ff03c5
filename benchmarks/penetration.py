"""How deep bodies overlap during rollouts of T1 and T3: the deepest contact at every recorded state, by pair.

python benchmarks/penetration.py
"""

import llm
import oag
from executor import rollout
from executor.scenes import library
from executor.sim.engine import Physics
from executor.sim.world import World

RUNS = (
    ("kitchen_t1", "put the glass into the refrigerator", 3),
    ("kitchen_t1", "put the glass into the refrigerator", 4),
    ("kitchen_t3", "put the apple into the bowl", 1),
)
LEAST_MM = 0.5
STILL_S = 1e-6
"""A step so short that it finds the contacts of a restored state and moves nothing."""


def deepest_mm(graph: oag.ObjectActionGraph, seed: int) -> dict[tuple[str, str], float]:
    """Return the deepest overlap in mm of each pair of links that overlap by at least 0.5 mm."""
    done = rollout(graph, seed=seed)
    found: dict[tuple[str, str], float] = {}
    with World(done.scene, physics=Physics(timestep_s=STILL_S)) as world:
        for state in done.trajectory.packed_states:
            world.unpack(state)
            world.step()
            for contact in world.contacts():
                pair = (f"{contact.a.owner}/{contact.a.link}", f"{contact.b.owner}/{contact.b.link}")
                depth_mm = -1000.0 * contact.separation_m
                if depth_mm >= max(LEAST_MM, found.get(pair, 0.0)):
                    found[pair] = depth_mm
    return found


if __name__ == "__main__":
    for scene_name, query, seed in RUNS:
        graph = oag.compose(llm.propose(query, library.load(scene_name)).task)
        for (first, second), depth_mm in sorted(deepest_mm(graph, seed).items()):
            print(f"{scene_name} seed {seed}: {first} and {second} {depth_mm:.2f} mm")
