"""The one door for files from outside: regular files within a limit, strict text, finite numbers, limited nesting.

Every package may use it, and it knows none of them.
"""
