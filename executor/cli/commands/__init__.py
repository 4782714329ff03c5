"""What each sub-command does, one file each; the file is imported when its command is chosen."""
