"""Who else can say where a body comes to rest or how it moves: a bare loop around PyBullet, and MuJoCo."""
