"""CoLa-A and CoLa-B as pure functions: bytes in any fragmentation to telegrams, values to bytes."""
