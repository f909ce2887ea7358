"""Search for better gains: descent, evolution, rescue, checkpoints."""
