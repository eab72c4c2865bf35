"""The hybrid action in MuJoCo, under a finger as the mechanism of a hinged key."""
