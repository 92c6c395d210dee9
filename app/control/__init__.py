"""From inputs to joint commands, 500 times a second: one pure step in a thin shell."""
