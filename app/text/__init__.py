"""Text for people: the catalogues, and how a code with values becomes a sentence. Only here a language is known."""
