"""What a body is: a tree of parts, its kinematics and masses; robots from files, URDF in and out."""
