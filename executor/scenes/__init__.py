"""The scenes that come with the package, and how one of them becomes many."""
