"""Where the operator wants to go: head motion, the intent filter, and driving where they look."""
