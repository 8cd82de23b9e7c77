"""From each driver to the board of newest inputs and to the logbook; and from the safety chain to the base."""
