"""The 0x500 family's wire format, dialect B2: pure functions and bounded assemblers, no clock, no bus."""
