"""The student: a robot that finds out who is worth learning from.

``agent.py`` tells its life from top to bottom, ``mind.py`` how it thinks, and ``phases.py`` names every way to do a
phase of that. The phases themselves have a room each: ``body`` (Section 3.2: what am I?), ``seeing`` (3.3: what do I
see?), ``moving`` (3.4: can I move like that?) and ``judging`` (is that one like me?). ``parameters`` holds everything
that is open, each with a default and a reason.

Nothing here knows of any world or backend: observations come in, actions go out.
"""
