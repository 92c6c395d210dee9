"""Two computers: the therapist's laptop with console and perception, the exoskeleton's with everything that moves."""
