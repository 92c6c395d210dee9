"""The Textual console: screens post and receive messages, nothing else."""
