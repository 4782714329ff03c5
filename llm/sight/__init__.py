"""What a vision-language model sees in a picture: things with boxes, doors and drawers, and what stands on what."""
