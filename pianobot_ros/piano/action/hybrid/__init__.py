"""The hybrid action, simulated exactly: elements, switching rules, modes and events."""
