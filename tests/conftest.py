"""What holds for every test."""

from __future__ import annotations

from hypothesis import settings

# How long an example takes is the machine's affair. The same examples every time: what `make test` says is to be about
# what has changed, and a failure is to be there again for whoever looks. `make explore` looks for new ones.
settings.register_profile("same for all", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None, max_examples=2000, print_blob=True)
settings.load_profile("same for all")
