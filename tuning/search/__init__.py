"""How better gains are sought: descent, evolution, rescue, checkpoints."""
