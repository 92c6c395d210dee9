"""Buttons that stop: the hardwired emergency stop's auxiliary contact, the wearer's button, the therapist's pedal."""
