"""A TiM571 on a TCP port, as strict as the device: for our own tests, and for other people's clients."""
