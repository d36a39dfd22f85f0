"""The bench without a bench: the real firmware on emulated microcontrollers, in one virtual time."""
