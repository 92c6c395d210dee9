"""After the session: summary, note, discomfort, next targets."""
