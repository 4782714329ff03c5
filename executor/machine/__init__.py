"""The machine: files, caches, optional libraries, Vulkan, worker processes, and what `doctor` tells of them."""
