"""Checks a certificate on one page: the standard library and this file, which shares no line with the project.

    python scripts/check_certificate.py CERTIFICATE.json

It follows the plan from its start by a table of primitives of its own. PROVED: everything that the plan needs is true.
CONDITIONAL: it is once the assumptions are granted, and a run is given that misses something. REFUTED: the run that is
given meets everything before the failure, and not the failure. Left to `scene2demo recheck`: that no run gets past a
failure, whether an assumption could be spared, distinctions of cases, pairs of `forpairs`, and whether links are well
formed. Exit code 0 when the verdict stands, 1 when it does not, 2 for what this page cannot read.

Source: docs/semantics.md, The primitives and Certificates.
"""

import hashlib
import json
import re
import sys
from collections.abc import Callable, Iterator
from itertools import product
from pathlib import Path
from typing import Any

ANY = "*"
ROBOT = ("near", "eef", "hand")
# A fact and the value that it must have (True), or must not have (False).
Need = tuple[tuple[str, ...], Any, bool]


def rows(number: int, sub: dict[str, Any], hand: str, scene: dict[str, Any]) -> tuple[list[list[Need]], list[Any]]:
    """Returns what a primitive needs (one of each list) and what it writes, the general before the special."""
    o, s = sub["target"], sub["support_goal"]
    held = hand[8:] if hand.startswith("holding ") else None
    carried: list[Any] = []
    if held and number in (6, 7, 17, 18):
        # Within a compartment of furniture a lift takes nothing out of it, but it does out of a bowl.
        vessels = [name for name in scene["items"] if name != held] if number == 7 else [ANY]
        carried = [(("ontop", held, ANY), False), *((("inside", held, name), False) for name in vessels)]
        for name in ("nextto", "touching", "under"):
            carried += [((name, held, ANY), None), ((name, ANY, held), None)]
    if number in (17, 18):
        return [], [(("near",), o if number == 17 else s), (("eef",), "home"), *carried]
    if number == 1:
        return [[(("near",), o, True)]], [(("eef",), f"before {o}")]
    if number == 2:
        return [[(("eef",), f"before {o}", True)]], [(("eef",), f"at {o}")]
    if number == 3:
        item = o in scene["items"]
        doors = [[(("inside", o, f), True, False), (("open", f), True, True)] for f in scene["articulated"] if item]
        takes = f"holding {o}" if item else f"gripping {o}"
        return [[(("eef",), f"at {o}", True)], [(("hand",), "empty", True)], *doors], [(("hand",), takes)]
    if number in (4, 19):
        return [[(("hand",), f"gripping {o}", True)]], [(("open", o), number == 4)]
    if number == 5:
        place = placement(sub["goal"], o) if held == o else None
        if place is None:
            return [], [(("hand",), "empty")]
        relation, where = place
        needs: list[list[Need]] = [[(("near",), where, True)]]
        if relation == "inside" and where in scene["articulated"]:
            needs.append([(("open", where), True, True)])
        return needs, [(("hand",), "empty"), ((relation, o, where), True), ((relation, where, o), False)]
    return [], [(("eef",), "home" if number == 6 else "free"), *carried]


def placement(goal: Any, target: str) -> tuple[str, str] | None:
    """Returns the first place on or in something that a goal's conjuncts give its target."""
    for part in conjuncts(read(goal) if isinstance(goal, str) else ["and", *(list(a) for a, value in goal if value)]):
        if part[0] in ("ontop", "inside") and len(part) == 3 and part[1] == target and part[2] != "gripper":
            return part[0], part[2]
    return None


def conjuncts(form: Any) -> Iterator[Any]:
    """Yields the parts of a conjunction, those within it included."""
    if form and form[0] == "and":
        for part in form[1:]:
            yield from conjuncts(part)
    else:
        yield form


def read(text: str) -> Any:
    """Returns a BDDL formula as nested lists."""
    stack: list[list[Any]] = [[]]
    for token in re.findall(r"[()]|[^\s()]+", text):
        if token == "(":
            stack.append([])
        elif token == ")":
            stack[-2].append(stack.pop())
        else:
            stack[-1].append(token)
    (form,) = stack[0]
    return form


def truth(form: Any, value: Callable[[tuple[str, ...]], Any], objects: dict[str, str]) -> bool | None:
    """Returns a formula's three-valued truth; None is unknown."""
    head = form[0]
    if head in ("forall", "exists", "forn"):
        variable, category = [part for part in form[-2] if part != "-"]
        chosen = [name for name, kind in objects.items() if category in (kind, "object")]
        each = [truth(replaced(form[-1], variable, name), value, objects) for name in chosen]
        if head == "forn":
            wanted, sure, open_ = int(form[1][0]), each.count(True), each.count(None)
            return None if sure <= wanted <= sure + open_ and open_ else sure == wanted
        return combined(each, all_of=head == "forall")
    if head == "imply":
        return truth(["or", ["not", form[1]], form[2]], value, objects)
    if head in ("and", "or"):
        return combined([truth(part, value, objects) for part in form[1:]], all_of=head == "and")
    if head == "not":
        found = truth(form[1], value, objects)
        return None if found is None else not found
    if head in ("forpairs", "fornpairs"):
        raise NotImplementedError("pairs: scene2demo recheck reads them")
    return met((tuple(form), True, True), value)


def replaced(form: Any, variable: str, name: str) -> Any:
    """Returns a form with a name for a variable."""
    return [replaced(p, variable, name) if isinstance(p, list) else name if p == variable else p for p in form]


def combined(values: list[bool | None], *, all_of: bool) -> bool | None:
    """Returns the three-valued conjunction or disjunction of values."""
    return not all_of if (not all_of) in values else None if None in values else all_of


def met(need: Need, value: Callable[[tuple[str, ...]], Any]) -> bool | None:
    """Returns whether a fact has the value it needs."""
    fact, wanted, positive = need
    if fact[0] == "inside" and fact[2:] == ("gripper",):
        fact, wanted = ("hand",), f"holding {fact[1]}"
    known = value(fact)
    return None if known is None else (known == wanted) is positive


class Rejected(Exception):
    """The certificate does not bear out its verdict."""


class Run:
    """The plan of a certificate on its way; a complete run takes what is unknown for false."""

    def __init__(self, cert: dict[str, Any], given: list[Any], *, complete: bool) -> None:
        self.scene, self.plan, self.complete = cert["scene"], cert["plan"], complete
        self.pending = sorted(
            [(time, tuple(fact), content) for time, fact, content in given], key=lambda entry: entry[0]
        )
        self.written: dict[tuple[str, ...], tuple[int, Any]] = {}
        self.steps = self.count = 0
        subtasks = self.plan["subtasks"]
        supplied = {"near": subtasks[0]["target"] if subtasks else None, "eef": "home", "hand": "empty"}
        for fact, content in self.scene["start"]:
            self.write(tuple(fact), content)
        for fact in [fact for fact, (_, content) in self.written.items() if content is True]:
            self.grant(fact, True)
        for entry in cert["assumptions"]:
            if entry["kind"] == "reset":
                (name,) = entry["fact"]
                if self.known((name,)) is not None or supplied[name] != entry["value"]:
                    raise Rejected(f"the reset does not supply {name}")
                self.write((name,), entry["value"])

    def write(self, fact: tuple[str, ...], content: Any) -> None:
        """Notes what a fact, or all facts of a pattern, became."""
        self.count += 1
        self.written[fact] = (self.count, content)

    def known(self, fact: tuple[str, ...]) -> Any:
        """Returns what was written last of a fact; None when that is unknown."""
        patterns = product(*([(fact[0],)] + [(name, ANY) for name in fact[1:]]))
        return max((self.written[p] for p in patterns if p in self.written), default=(0, None))[1]

    def value(self, fact: tuple[str, ...]) -> Any:
        """Returns what a fact is in this run; None when that is open."""
        found = self.known(fact)
        return False if found is None and self.complete and fact[0] not in ROBOT else found

    def grant(self, fact: tuple[str, ...], content: bool) -> None:
        """Takes something for given, and what it excludes: nothing is on itself, no two things on each other."""
        if self.known(fact) not in (None, content) or fact[0] in ROBOT or ANY in fact:
            raise Rejected(f"{fact} is taken for {content} against what is known")
        self.write(fact, content)
        if content and fact[0] in ("ontop", "inside"):
            converse = (fact[0], *reversed(fact[1:]))
            if converse == fact or self.known(converse):
                raise Rejected(f"{fact} cannot be")
            self.write(converse, False)

    def holds(self, needed: Any) -> bool | None:
        """Returns whether a condition of the plan holds here."""
        while self.pending and self.pending[0][0] <= 2 * self.steps + 1:
            self.grant(*self.pending.pop(0)[1:])
        if isinstance(needed, str):
            return truth(read(needed), self.value, self.scene["objects"])
        return combined([met((tuple(names), True, wanted), self.value) for names, wanted in needed], all_of=True)

    def places(self) -> Iterator[tuple[list[Any], bool | None]]:
        """Yields every place where the plan needs something, and whether it is so."""
        for index, subtask in enumerate(self.plan["subtasks"]):
            yield ["init", index, -1], self.holds(subtask["init"])
            if subtask["flow"] is None:
                yield ["no-flow", index, -1], self.holds(subtask["goal"])
                raise Rejected(f"subtask {index} has no flow")
            for position, action in enumerate(subtask["flow"]):
                self.holds([])
                hand = self.known(("hand",))
                if hand is None:
                    raise Rejected("what the hand does is unknown")
                needs, writes = rows(
                    int(next(iter(action))) if isinstance(action, dict) else action, subtask, hand, self.scene
                )
                clauses = [combined([met(need, self.value) for need in clause], all_of=False) for clause in needs]
                yield ["precondition", index, position], combined(clauses, all_of=True)
                for fact, content in writes:
                    self.write(fact, content)
                self.steps += 1
            yield ["goal", index, -1], self.holds(subtask["goal"])
        yield ["task-goal", len(self.plan["subtasks"]), -1], self.holds(self.plan["goal"])


def check(cert: dict[str, Any]) -> str:
    """Returns what was found to stand.

    Raises:
        Rejected: The verdict does not stand.
        NotImplementedError: It takes what this page does not read.
    """
    for key, part in (("task_hash", cert["plan"]), ("scene_sha", cert["scene"])):
        text = json.dumps(part, sort_keys=True, separators=(",", ":"))
        if hashlib.sha256(text.encode()).hexdigest() != cert[key]:
            raise Rejected(f"{key} is of something else")
    if cert["verdict"] == "REFUTED":
        for place, held in Run(cert, cert["counterexample"], complete=True).places():
            if place == cert["failure"] and held is False:
                return f"the run given ends at {place}"
            if held is not True:
                raise Rejected(f"the run given ends at {place}, not at {cert['failure']}")
        raise Rejected("the run given meets everything")
    if cert["cases"]:
        raise NotImplementedError("distinctions of cases: scene2demo recheck reads them")
    assumed = [entry for entry in cert["assumptions"] if entry["kind"] == "assumed"]
    if bool(assumed) is not (cert["verdict"] == "CONDITIONAL"):
        raise Rejected(f"{len(assumed)} things are assumed")
    run = Run(cert, [(entry["time"], entry["fact"], entry["value"]) for entry in assumed], complete=False)
    for place, held in run.places():
        if held is not True:
            raise Rejected(f"{place} is {'open' if held is None else 'false'}")
    if assumed and all(held for _, held in Run(cert, cert["counterexample"], complete=True).places()):
        raise Rejected("the run given meets everything, so that nothing has to be assumed")
    return f"everything that {run.steps} steps need is so"


if __name__ == "__main__":
    try:
        print("stands:", check(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))))
    except Rejected as reason:
        sys.exit(f"does not stand: {reason}")
    except (NotImplementedError, OSError, ValueError, TypeError, KeyError, IndexError, AttributeError) as reason:
        print(f"cannot be read: {reason}", file=sys.stderr)
        sys.exit(2)
