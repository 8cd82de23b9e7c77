"""The command line: one thin module per command group; the only place that prints."""
