"""What a report says beside the verdict: findings, and why something fails."""
