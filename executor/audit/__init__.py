"""Audit of recorded episodes: whether each is what its record says, decided without the goal check.

    for verdict in audit_store(EpisodeStore.open(path)): ...        # executor.audit.episodes

`geometry` and `decision` decide success again from the engine's own shapes, contacts and velocities in recorded states;
`checks` compares start, end, sentence, plan and assets; `replay` repeats the commands.
"""
