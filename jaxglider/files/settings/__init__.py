"""Settings of autopilots that fly, as gains and back."""
