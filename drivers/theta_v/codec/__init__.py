"""What the camera's bytes mean: descriptors, negotiation, payloads, pictures, PTP, USB/IP. Pure, no I/O."""
