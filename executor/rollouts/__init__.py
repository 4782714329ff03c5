"""A task executed: subtasks one after the other, judged, recorded, and gone on from checkpoints."""
