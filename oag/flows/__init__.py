"""Action flows for subtasks that have none, or the proof that there is none."""
