"""The protocol of Stanley Innovation's firmware on UDP and USB, ids 0x1800 to 0x1803 (fact sheet section 11).

Sending any of it to a base of the 0x500 family is said to ruin that base: only where configured.
"""
