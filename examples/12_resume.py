"""Go back to the start of a subtask, exactly.

Every subtask begins at a checkpoint. Resuming from it ends in the same state hash as the run that made it, so another
flow can be tried from the very state in which the first one failed.

    python examples/12_resume.py
"""

import llm
import oag
from executor import resume, rollout
from executor.scenes import library

if __name__ == "__main__":
    scene = library.load("kitchen_t3")
    graph = oag.compose(llm.propose("put the apple into the bowl", scene).task)
    done = rollout(graph, seed=1)
    again = resume(graph, done, subtask=1)
    print("first run: ", done.state_hash)
    print("from there:", again.state_hash)
    if again.state_hash != done.state_hash:
        raise SystemExit(1)
