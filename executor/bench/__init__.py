"""Success rates over many units, resumable, beside the paper's main table."""
