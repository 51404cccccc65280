"""A short drawn recording through the core, compared with what it gave when somebody last looked at it."""
