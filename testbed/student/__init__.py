"""The student: a robot that finds out who is worth learning from.

``agent.py`` tells its life from top to bottom. The phases have a file each: ``self_discovery.py`` (Section 3.2),
``teacher_modelling.py`` (3.3), ``imitation.py`` (3.4) and ``verdict.py``; ``imagination.py`` simulates self-models,
``search.py`` is the hill climber, ``parameters.py`` holds everything that the paper leaves open.

Nothing here knows of any world or backend: observations come in, actions go out.
"""
