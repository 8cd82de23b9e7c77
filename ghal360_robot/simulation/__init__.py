"""A furnished world without a robot in it: its shapes, its pictures, and the people who search in it."""
