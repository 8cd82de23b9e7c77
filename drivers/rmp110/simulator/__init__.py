"""An RMP 110 of dialect B2 on any bus, as strict as the fact sheet says the real one is."""
