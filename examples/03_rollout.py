"""Run a proved plan in the physics and see the evidence.

The numbers that the flow left open come back filled in. The same seed gives the same states, bit by bit: run it twice
and compare the hash. Needs the extra `sim`; no renderer, no graphics card.

    python examples/03_rollout.py
"""

import llm
import oag
from executor import rollout
from executor.scenes import library
from oag.model.actions import flow_to_json

if __name__ == "__main__":
    scene = library.load("kitchen_t3")
    proposal = llm.propose("put the apple into the bowl", scene)
    done = rollout(oag.compose(proposal.task), seed=0)
    for subtask in done.subtasks:
        print(f"{subtask.name}: {flow_to_json(subtask.flow)}")
        for reading in subtask.readings:
            print(f"  {reading.literal} is {reading.value}")
    print(
        f"{'success' if done.succeeded else done.failure} after {done.simulated_s:.0f} s, state {done.state_hash[:12]}"
    )
    if not done.succeeded:
        raise SystemExit(1)
