"""The world: where a student meets its teachers.

``env.py`` is the PettingZoo environment, ``backend.py`` what it asks of a world, ``bullet.py`` the simulated one;
``gaits.py`` is how teachers move, ``placement.py`` where they stand, ``optics.py`` how the rig's sensors see them.
"""
