"""The glider: its parameters, forces, actuators, and what the controller believes."""
