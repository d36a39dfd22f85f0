"""What stands on the bench: robots of both builds behind one interface, as in lerobot."""
