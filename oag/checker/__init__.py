"""The independent check of certificates; it knows the language and the table of primitives, nothing of `verify`."""
