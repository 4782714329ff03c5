"""From a sentence to a proved plan, without a model or a key.

The offline planner expands the query, decomposes it, writes the BDDL, adjusts sizes and proposes flows whose numbers
are left open: the executor fills them in against the geometry. What it does not understand it says, with near readings.

    python examples/02_plan.py
"""

import llm
import oag
from executor.scenes import library
from oag.model.actions import flow_to_json

if __name__ == "__main__":
    scene = library.load("kitchen_t1")
    proposal = llm.propose("put the cup into the fridge", scene)
    print(proposal.task.detail)
    for subtask in proposal.task.subtasks:
        print(f"  {subtask.name}: {flow_to_json(subtask.flow)}")
    print(oag.compose(proposal.task).verify().verdict)
    try:
        llm.propose("put the banana into the fridge", scene)
    except llm.QueryError as error:
        print(error)
