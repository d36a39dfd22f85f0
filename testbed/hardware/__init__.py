"""The physical bench: robots on serial ports, a stereo rig of two cameras, and their emulation."""
