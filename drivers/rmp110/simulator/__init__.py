"""An RMP 110 in any dialect, on CAN, UDP or a serial device, as strict as the fact sheet says the real one is."""
