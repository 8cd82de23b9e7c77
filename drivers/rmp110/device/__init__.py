"""The base as an async context manager: link, identification, modes, motion, state."""
