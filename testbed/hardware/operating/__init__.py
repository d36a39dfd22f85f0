"""What the commands do: find, set up, calibrate and drive a bench."""
