"""The digital hand signs and presses through a course of gestures; what happened is told in numbers."""
