"""What a run leaves in its folder: files, reports, data sets."""
