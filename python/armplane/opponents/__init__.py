"""Controllers of others, a class each (docs/arena.md)."""
