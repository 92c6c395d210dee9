"""A session as one self-contained page: what was done, how well, what went wrong, and how far it is proven."""
