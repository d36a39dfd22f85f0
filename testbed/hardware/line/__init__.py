"""Bytes on wires: the protocol, its link with retries, ports, and the servos' bus."""
