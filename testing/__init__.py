"""Sessions, hosts and trails that tests and benches share. Tests and tools import this, and never each other."""
