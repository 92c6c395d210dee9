"""The digital hand signs and presses through a scenario of gestures; the result is reported in numbers."""
