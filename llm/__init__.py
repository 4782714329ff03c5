"""Proposals: from a query and a scene to a task with subtasks, formulas, scales and action flows.

    proposal = llm.propose("put the glass into the refrigerator", scene)
    report = oag.compose(proposal.task).verify()

The built-in offline planner needs no model. A query that it cannot place raises `QueryError`, which says what was
understood, what stands in the way and what would work; it never guesses silently (`Proposal.notes` says what was
taken on trust).
"""

from llm.errors import LlmError, ProposalError, ProposerError, QueryError, RefusalCode
from llm.offline.lexicon import Lexicon, LexiconError
from llm.offline.planner import OfflinePlanner
from llm.proposal import Expanded, Proposal
from llm.proposer import Proposer, propose

__all__ = [
    "Expanded",
    "Lexicon",
    "LexiconError",
    "LlmError",
    "OfflinePlanner",
    "Proposal",
    "ProposalError",
    "Proposer",
    "ProposerError",
    "QueryError",
    "RefusalCode",
    "propose",
]
