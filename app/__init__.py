"""Puts everything together: perception, control, console, evaluation, processes, links, the `rleex` command."""
