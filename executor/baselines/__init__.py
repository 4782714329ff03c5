"""What others do, in our rooms: baselines that the table of the benchmark shows beside the executor's own rows."""
