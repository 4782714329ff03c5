"""Read, evaluate and print BDDL, and see what a mistake looks like.

Evaluation is three-valued: a fact that the state does not mention is unknown, not false.

    python examples/10_bddl.py
"""

import bddl

GOAL = "(and (inside glass_0 refrigerator_0) (not (open refrigerator_0)))"

if __name__ == "__main__":
    goal = bddl.parse_formula(GOAL)
    print(bddl.format(goal))
    for name, state in {
        "nothing known": {},
        "the glass is inside": {bddl.Atom("inside", ("glass_0", "refrigerator_0")): True},
        "the door is open": {bddl.Atom("open", ("refrigerator_0",)): True},
    }.items():
        print(f"{name}: {bddl.evaluate(goal, state)}")
    try:
        bddl.parse_formula("(not (open refrigerator_0)")  # a parenthesis is missing, as in the paper's table
    except bddl.BDDLError as error:
        print(error)
