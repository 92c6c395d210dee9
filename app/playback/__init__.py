"""A recorded session shown again: the state of everything at any moment, and a film of it."""
