// Walls of a room are marked by texture coordinates that no other mesh has: 64 repeats on, or, for a colour, blue + 4096.

bool isWall(vec2 uv) { return uv.x > 32.0 || uv.y > 4095.5; }
